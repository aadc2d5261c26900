// Maps: east to the right, north up, equal scales, in local metres or kilometres.

/** The largest of 1, 2 and 5 times a power of ten that is no more than a value. */
report.roundBelow = function (value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [5, 2, 1].find((step) => step * power <= value * 1.000001) * power;
};

/** Round values between two ends, `most` of them at most. */
report.ticks = function (low, high, most) {
  const power = 10 ** Math.floor(Math.log10((high - low) / most));
  const step = [1, 2, 5, 10].map((part) => part * power).find((size) => (high - low) / size <= most);
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  return { step, values: Array.from({ length: Math.max(count, 0) }, (_, k) => (first + k) * step) };
};

/**
 * A map.
 *
 * `ground` is what lies under everything else; `traces(colours, map)` returns Plotly's traces over it, in the map's unit:
 * `map.unit` metres. `labels` are texts at places, [{ text, east, north, rank, colour }], set so that none covers
 * another; those that find no room are left out. Shapes and notes of the frame are the map's own.
 */
report.map = function (host, label, ground, traces, labels, paint) {
  const [south, west] = ground.low;
  const [north, east] = ground.high;
  const map = { host, labels, hidden: new Set(), unit: Math.max(east - west, north - south) > 4000 ? 1000 : 1 };
  const name = map.unit === 1000 ? "km" : "m";
  const corners = ground.corners;

  /** Longitude of places along the middle of the map, and latitude likewise. */
  const along = corners && {
    longitude: [(corners[0][0] + corners[2][0]) / 2, (corners[1][0] + corners[3][0]) / 2],
    latitude: [(corners[0][1] + corners[1][1]) / 2, (corners[2][1] + corners[3][1]) / 2],
  };
  const share = (value, from, to, [low, high]) => low + ((value - from) / (to - from)) * (high - low);
  /** Degrees with their side; longitudes, which go on beyond 180 degrees, within them. */
  const degrees = function (value, decimals, signs, space) {
    const within = Math.abs(value) > 180 ? value - 360 * Math.sign(value) : value;
    return `${Math.abs(within).toFixed(decimals)}°${space}${signs[within < 0 ? 1 : 0]}`;
  };
  map.place = function (n, e) {
    if (!along) return "";
    const latitude = degrees(share(n, south, north, along.latitude), 4, "NS", "\u00a0");
    return `${latitude}, ${degrees(share(e, west, east, along.longitude), 4, "EW", "\u00a0")}`;
  };

  function depthLines(colours) {
    if (!ground.depths) return [];
    const [norths, easts, depths] = ["north", "east", "depth"].map((part) => report.unpack(ground.depths[part]));
    const under = (depth) => (depth > 0 ? depth : null);
    const rows = Array.from(norths, (_, i) => Array.from(easts, (_, j) => under(depths[i * easts.length + j])));
    const deepest = depths.reduce((most, depth) => Math.max(most, depth), 0);
    const { step } = report.ticks(0, Math.max(deepest, 1), 8);
    const labelfont = { size: 9, color: colours.depth, family: report.font };
    const lines = { coloring: "none", showlabels: true, labelfont, start: step, end: deepest, size: step };
    return [
      {
        type: "contour",
        name: "depth of the sea bed",
        meta: "depths",
        x: Array.from(easts, (e) => e / map.unit),
        y: Array.from(norths, (n) => n / map.unit),
        z: rows,
        showscale: false,
        hoverinfo: "skip",
        line: { width: 0.8, color: colours.depth },
        contours: lines,
        autocontour: false,
        connectgaps: false,
        visible: !map.hidden.has("depths"),
      },
    ];
  }

  function chartImages() {
    if (!ground.chart) return [];
    const { low, high } = ground.chart;
    const place = { x: low[1] / map.unit, y: high[0] / map.unit };
    const edges = { sizex: (high[1] - low[1]) / map.unit, sizey: (high[0] - low[0]) / map.unit };
    const shown = { sizing: "stretch", layer: "below", visible: !map.hidden.has("chart") };
    return [{ source: ground.chart[report.theme()], xref: "x", yref: "y", ...place, ...edges, ...shown }];
  }

  /** Scale, arrow to the north, longitudes and latitudes along the edges, labels, for the ranges that are shown. */
  function furniture(ranges, size) {
    const colours = report.colours();
    const [[left, right], [bottom, top]] = ranges;
    const length = report.roundBelow(0.22 * (right - left));
    const metres = length * map.unit;
    const part = length / (right - left);
    const text = metres >= 1000 ? `${metres / 1000} km` : `${metres} m`;
    const corner = { xref: "x domain", yref: "y domain" };
    const foot = 18 / size.height;
    const bar = { x0: 0.02, x1: 0.02 + part, y0: 14 / size.height, y1: foot, fillcolor: colours.text };
    const shapes = [{ type: "rect", ...corner, ...bar, line: { width: 0 }, layer: "above" }];
    const arrow = { arrowhead: 2, arrowsize: 1.1, arrowwidth: 1.8, arrowcolor: colours.text };
    const scale = { x: 0.02 + part / 2, y: foot, yanchor: "bottom", text: `<b>${text}</b>` };
    const compass = { x: 0.035, y: foot, ax: 0, ay: 30, yshift: 56, text: "<b>N</b>", ...arrow };
    const notes = [
      { ...corner, ...scale, showarrow: false, font: { size: 11 } },
      { ...corner, ...compass, showarrow: true, font: { size: 12 } },
    ];
    if (along && map.wide) {
      const x = (x) => ({ xref: "x", yref: "y domain", x, y: 1, yanchor: "bottom", yshift: 1 });
      const y = (y) => ({ xref: "x domain", yref: "y", x: 1, y, xanchor: "left", xshift: 3, textangle: 0 });
      const edges = [
        [left, right, [west, east, along.longitude], "EW", size.width / 110, x],
        [bottom, top, [south, north, along.latitude], "NS", size.height / 70, y],
      ];
      for (const [from, to, whole, signs, room, where] of edges) {
        const ends = [from, to].map((value) => share(value * map.unit, ...whole));
        const { step, values } = report.ticks(...ends, Math.max(2, Math.floor(room)));
        const decimals = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
        for (const value of values) {
          const at = from + ((value - ends[0]) / (ends[1] - ends[0])) * (to - from);
          const text = degrees(value, decimals, signs, " ");
          notes.push({ text, showarrow: false, font: { size: 10, color: colours.quiet }, ...where(at) });
        }
      }
    }
    if (!map.hidden.has("names")) notes.push(...placed(ranges, size));
    return { shapes, annotations: notes };
  }

  const pen = document.createElement("canvas").getContext("2d");
  /** Labels beside their places, each where it covers neither another label nor a place; dropped where it must. */
  function placed([[left, right], [bottom, top]], size) {
    const colours = report.colours();
    const scale = size.width / (right - left);
    const pixel = ({ east: e, north: n }) => [(e / map.unit - left) * scale, (top - n / map.unit) * scale];
    const small = size.width < 420 && right - left > (0.6 * (east - west)) / map.unit;
    const inside = map.labels.filter(({ east: e, north: n, rank }) => {
      const [x, y] = [e / map.unit, n / map.unit];
      return !(small && rank > 2) && x >= left && x <= right && y >= bottom && y <= top;
    });
    const taken = inside.map((one) => {
      const [x, y] = pixel(one);
      return [x - 6, y - 6, x + 6, y + 6];
    });
    // The corner of the scale and the arrow to the north.
    taken.push([0, size.height - 78, 0.25 * size.width, size.height]);
    const apart = (one, other) =>
      one[0] >= other[2] || one[2] <= other[0] || one[1] >= other[3] || one[3] <= other[1];
    const clear = (box, own) => taken.every((other, k) => k === own || apart(box, other));
    pen.font = `11px ${report.font}`;
    const order = inside.map((_, k) => k).sort((a, b) => inside[a].rank - inside[b].rank);
    const notes = [];
    for (const k of order) {
      const [x, y] = pixel(inside[k]);
      const [wide, tall] = [pen.measureText(inside[k].text).width + 2, 12];
      const around = [[1, -1], [1, 1], [-1, -1], [-1, 1], [1, 0], [-1, 0], [0, -1], [0, 1]]; // prettier-ignore
      for (const [h, v] of around) {
        const distance = h && v ? 5 : 8;
        const [cx, cy] = [x + h * (distance + wide / 2), y + v * (distance + tall / 2)];
        const box = [cx - wide / 2, cy - tall / 2, cx + wide / 2, cy + tall / 2];
        if (box[0] < 0 || box[2] > size.width || box[1] < 0 || box[3] > size.height || !clear(box, k)) continue;
        taken.push(box);
        const { east: e, north: n, text, colour } = inside[k];
        notes.push({
          ...{ xref: "x", yref: "y", x: e / map.unit, y: n / map.unit, xshift: cx - x, yshift: y - cy },
          ...{ showarrow: false, text: report.literal(text), borderpad: 0, captureevents: false },
          font: { size: 11, color: colours[colour] || colours.text },
        });
        break;
      }
    }
    return notes;
  }

  function draw(colours, width) {
    const wide = width >= 480;
    map.wide = wide;
    const margin = { l: wide ? 54 : 42, r: along && wide ? 54 : 8, t: along && wide ? 24 : 8, b: 44 };
    const inner = width - margin.l - margin.r;
    // All of it is to be seen below the slider.
    const room = report.printing ? 900 : Math.max(window.innerHeight - 150, 380);
    const tall = Math.min(Math.max(inner * ((north - south) / (east - west)), 220), 1.25 * inner, 900, room);
    const ranges = [[west / map.unit, east / map.unit], [south / map.unit, north / map.unit]];
    const under = depthLines(colours);
    const frame = { constrain: "domain", automargin: false, showgrid: false, mirror: true };
    const equal = { scaleanchor: "x", scaleratio: 1 };
    return {
      data: [...under, ...traces(colours, map)],
      height: tall + margin.t + margin.b,
      layout: {
        margin,
        plot_bgcolor: colours.water,
        dragmode: matchMedia("(pointer: coarse)").matches ? false : "pan",
        xaxis: report.axis(colours, `east [${name}]`, { ...frame, range: ranges[0] }),
        yaxis: report.axis(colours, `north [${name}]`, { ...frame, range: ranges[1], ...equal }),
        images: chartImages(),
        ...furniture(ranges, { width: inner, height: tall }),
      },
    };
  }

  function size() {
    const { xaxis, yaxis } = host._fullLayout;
    const ranges = [xaxis.range, yaxis.range].map((range) => [...range]);
    return [ranges, { width: xaxis._length, height: yaxis._length }];
  }
  map.refurnish = function () {
    return Plotly.relayout(host, furniture(...size()));
  };
  /** Zoom by a factor about the middle of the map; without one show all of it. */
  map.zoom = function (share) {
    const [[[left, right], [bottom, top]]] = size();
    const about = (low, high) => [-1, 1].map((side) => (low + high) / 2 + (side * share * (high - low)) / 2);
    const whole = [[west, east], [south, north]].map((ends) => ends.map((end) => end / map.unit));
    const [x, y] = share ? [about(left, right), about(bottom, top)] : whole;
    return Plotly.relayout(host, { "xaxis.range": x, "yaxis.range": y });
  };
  const button = (words, share, label) => {
    const attributes = { type: "button", "aria-label": label, onclick: () => map.zoom(share) };
    return element("button", attributes, words);
  };
  map.buttons = () => {
    const [closer, farther] = [button("+", 1 / 1.6, "Zoom in"), button("−", 1.6, "Zoom out")];
    return element("div.choices.screen", closer, farther, button("Whole map"));
  };
  /** Show or hide a layer: the chart, the names, what is painted, or all traces whose `meta` is its name. */
  map.toggle = function (layer, on) {
    if (on) map.hidden.delete(layer);
    else map.hidden.add(layer);
    if (layer === "names") map.refurnish();
    else if (layer === "chart") Plotly.relayout(host, { "images[0].visible": on });
    else {
      const members = host.data.map((trace, k) => (trace.meta === layer ? k : -1)).filter((k) => k >= 0);
      if (members.length) Plotly.restyle(host, { visible: on }, members);
    }
    map.repaint();
  };

  /**
   * Paint what changes with time, between the sea bed and the waypoints.
   *
   * It is no trace: to redraw a figure with its axes and depth lines takes too long for every step of the slider.
   * `paint(x, y)` returns SVG elements; `x` and `y` turn metres east and north into the figure's pixels.
   */
  map.repaint = function () {
    const plot = paint && host.querySelector(".cartesianlayer .overplot > .xy");
    if (!plot) return;
    if (!map.group || map.group.parentNode !== plot) {
      map.group = element("g.painted");
      plot.insertBefore(map.group, plot.querySelector(".scatterlayer"));
    }
    const { xaxis, yaxis } = host._fullLayout;
    map.group.replaceChildren(...paint((e) => xaxis.c2p(e / map.unit), (n) => yaxis.c2p(n / map.unit)));
  };

  map.figure = report.drawn(host, label, draw, (_, first) => {
    if (first) {
      host.on("plotly_afterplot", () => map.repaint());
      host.on("plotly_relayout", (change) => {
        if (Object.keys(change).some((key) => key.startsWith("xaxis") || key.startsWith("yaxis")))
          map.refurnish();
      });
    }
    map.refurnish();
    map.repaint();
  });
  return map;
};
