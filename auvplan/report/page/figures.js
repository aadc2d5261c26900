// Figures: drawn by Plotly in the page's colours, redrawn where colours, width or the medium change.

report.shownFigures = [];

report.font = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif';

/** An axis in the page's colours. */
report.axis = function (colours, title, more = {}) {
  return {
    title: { text: title, font: { size: 12 }, standoff: 8 },
    gridcolor: colours.grid,
    zeroline: false,
    linecolor: colours.line,
    showline: true,
    mirror: false,
    ticks: "outside",
    ticklen: 4,
    tickcolor: colours.line,
    tickfont: { size: 11 },
    automargin: true,
    ...more,
  };
};

/** A logarithmic axis with 1, 2 and 5 times each power of ten between the values that are shown. */
report.logAxis = function (colours, title, values, more) {
  const known = values.filter((value) => report.isNumber(value) && value > 0);
  const [low, high] = known.length ? [Math.min(...known), Math.max(...known)] : [1, 10];
  const tickvals = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
    tickvals.push(...[1, 2, 5].map((part) => Number(`${part}e${power}`)));
  const wide = Math.log10(high / low) > 2.2;
  const few = tickvals.filter((value) => !wide || /^1(0*|e.*)$|^0\.0*1$/.test(String(value)));
  return report.axis(colours, title, {
    type: "log",
    tickvals: few,
    ticktext: few.map((value) => value.toLocaleString("en", { maximumSignificantDigits: 3 })),
    ...more,
  });
};

/** Points, or what `more` makes of them. */
report.points = (x, y, more) => ({ type: "scatter", mode: "markers", x, y, ...more });

/** A line that says nothing under the pointer. */
report.line = (x, y, line, more) => ({ mode: "lines", x, y, line, hoverinfo: "skip", ...more });

/** A straight line over all of a figure, at a value of its axis `x` or of another one upwards. */
report.rule = function (axis, value, line) {
  const [at, along] = axis === "x" ? ["x", "y"] : ["y", "x"];
  const ends = { [`${at}0`]: value, [`${at}1`]: value, [`${along}0`]: 0, [`${along}1`]: 1 };
  return { type: "line", [`${at}ref`]: axis, [`${along}ref`]: "paper", ...ends, line };
};

/** A layout with its legend above the figure. */
report.legendAbove = {
  showlegend: true,
  legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 },
  margin: { l: 62, r: 14, t: 34, b: 46 },
};

/** Error bars from values to their ends, none where an end is not known. */
report.errors = (values, low, high, more) => ({
  type: "data",
  symmetric: false,
  array: values.map((value, k) => (high[k] ?? value) - value),
  arrayminus: values.map((value, k) => value - (low[k] ?? value)),
  ...more,
});

/**
 * A figure in the place of an element.
 *
 * `draw(colours, width)` returns `data`, `layout` and `height`; `after(host, first)` is called whenever it is drawn.
 */
report.drawn = function (host, label, draw, after) {
  host.classList.add("figure");
  host.setAttribute("role", "group");
  host.setAttribute("aria-label", label);
  const figure = { host, width: 0 };
  figure.draw = function (width = host.clientWidth) {
    if (!width) return;
    figure.width = width;
    const colours = report.colours();
    const made = draw(colours, width);
    const font = { family: report.font, size: 12, color: colours.text };
    const [clear, buttons] = ["rgba(0,0,0,0)", ["select2d", "lasso2d", "autoScale2d"]];
    const layout = {
      paper_bgcolor: clear,
      plot_bgcolor: clear,
      showlegend: false,
      hovermode: "closest",
      margin: { l: 58, r: 14, t: 12, b: 46 },
      font,
      hoverlabel: { align: "left", font, bgcolor: colours.card, bordercolor: colours.line },
      modebar: { bgcolor: clear, color: colours.quiet, activecolor: colours.accent },
      ...made.layout,
      width,
      height: made.height,
      autosize: false,
    };
    const config = {
      ...{ displaylogo: false, displayModeBar: false, responsive: false, scrollZoom: false, showTips: false },
      doubleClick: "reset",
      modeBarButtonsToRemove: buttons,
    };
    const first = !figure.made;
    figure.made = true;
    Plotly.react(host, made.data, layout, config);
    if (after) after(host, first);
  };
  figure.draw();
  report.themed.push(() => figure.draw(report.printing ? figure.width : undefined));
  new ResizeObserver(() => {
    if (!report.printing && host.clientWidth && Math.abs(host.clientWidth - figure.width) > 1) figure.draw();
  }).observe(host);
  report.shownFigures.push(figure);
  return figure;
};

/** A line at a value of a figure's horizontal axis; `move()` puts it where `at()` says. */
report.cursor = function (host, at) {
  const line = element("div.cursor");
  const move = () => {
    const { xaxis, _size: size } = host._fullLayout;
    const place = xaxis.c2p(at());
    line.hidden = !(place >= 0 && place <= xaxis._length);
    const [left, top, height] = [xaxis._offset + place, size.t, size.h].map((pixels) => `${pixels}px`);
    Object.assign(line.style, { left, top, height });
  };
  host.append(line);
  host.on("plotly_afterplot", move);
  return move;
};

/** What is printed is light, and as wide as the paper. */
report.print = function (begins) {
  if (report.printing === begins) return;
  report.printing = begins;
  const open = begins ? [...document.querySelectorAll("details:not([open])")] : report.opened || [];
  for (const part of open) part.open = begins;
  report.opened = begins ? open : [];
  for (const figure of report.shownFigures) {
    if (begins)
      figure.width = figure.host.closest(".mapgrid") ? 500 : figure.host.closest(".pair") ? 330 : 690;
  }
  report.applyTheme();
};
window.addEventListener("beforeprint", () => report.print(true));
window.addEventListener("afterprint", () => report.print(false));
