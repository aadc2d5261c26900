// The page of departures: what a mission or a leg comes to by when it leaves.

(function () {
  const { departures, leg, least, available, provenance, name, description } = report.data;
  const feasible = departures.filter((one) => one.feasible);
  const best = departures.find((one) => one.best);
  const dated = departures.every((one) => one.departure_utc);
  const powered = departures.some((one) => "energy_wh" in one);
  const moment = (one) =>
    dated ? one.departure_utc.replace("T", " ").replace(/:00Z$/, "") : `+${report.hours(one.departure_s)}`;

  const [all, few] = [report.counted(departures.length, "departure"), feasible.length];
  const clear = best && (best.clearance_m === null ? "open water" : `${report.fixed(best.clearance_m)} m clear`);
  const of = available ? ` of ${report.fixed(available)} s` : "";
  const kinds = dated ? "times in UTC" : "hours after the scenario's departure";
  report.head({
    title: name,
    badge: few ? `${few} of ${all} feasible` : "no departure is feasible",
    good: few > 0,
    line: report.joined(" · ", leg ? "departures of a leg" : "departures of a mission", kinds, description),
    tiles: best && [
      ["best departure", moment(best), dated ? "UTC" : "after the scenario's"],
      [leg ? "travel time" : "mission time", report.hours(best.time_s), `${report.fixed(best.time_s)} s${of}`],
      leg
        ? ["distance", `${report.fixed(best.length_m / 1000, 1)} km`, clear]
        : ["total priority", report.figure(best.total_priority, 3), report.counted(best.tasks, "task")],
      powered && ["energy", `${report.fixed(best.energy_wh)} Wh`, "by the vehicle's power model"],
      ["current", `${report.fixed(best.current_m_s, 2)} m/s`, "mean at that departure"],
    ],
  });

  const panels = [
    !leg && ["total_priority", "total priority", "task", 1],
    !leg && ["tasks", "tasks", "static", 1],
    ["time_s", leg ? "travel time [min]" : "mission time [min]", "plan", 1 / 60],
    powered && ["energy_wh", "energy [Wh]", "route", 1],
    ["current_m_s", "current [m/s]", "earlier", 1],
  ].filter(Boolean);
  const host = element("div", { id: "departures" });
  const note =
    "Departures that are not feasible are shaded; the star is the best: most priority, then least " +
    `${least}, then the earliest. A click marks the row below.`;
  report.section("when", "When to leave", note, host);
  const when = departures.map((one) => (dated ? one.departure_utc : one.departure_s / 3600));
  const draw = (colours) => {
    const [rows, gap] = [panels.length, 0.05];
    const tall = (1 - gap * (rows - 1)) / rows;
    const axisName = (k) => (k ? `y${k + 1}` : "y");
    const data = panels.flatMap(([column, title, colour, factor], k) => {
      const y = departures.map((one) => ((one[column] ?? null) === null ? null : factor * one[column]));
      const [color, yaxis] = [colours[colour], axisName(k)];
      const line = report.points(when, y, {
        mode: "lines+markers",
        yaxis,
        name: title,
        customdata: departures.map((_, at) => at),
        line: { color, width: 1.6 },
        marker: { size: 7, color },
        hovertemplate: `%{x}<br>${title}: %{y:,.4g}<extra></extra>`,
      });
      const at = departures.indexOf(best);
      const marker = { symbol: "star", size: 16, color: colours.start, line: { color: "#000000", width: 1 } };
      const star = report.points([when[at]], [y[at]], { yaxis, hoverinfo: "skip", marker });
      return at >= 0 && column !== "current_m_s" ? [line, star] : [line];
    });
    const places = when.map((value) => (dated ? new Date(value).getTime() : value));
    const back = (value) => (dated ? new Date(value).toISOString() : value);
    const half = places.length > 1 ? (places[1] - places[0]) / 2 : dated ? 1.8e6 : 0.5;
    const around = (first, last) => [back(first - half), back(last + half)];
    const shade = { fillcolor: report.mix(colours.earlier, 0.16), line: { width: 0 }, layer: "below" };
    const shapes = places.filter((_, k) => !departures[k].feasible).map((place) => {
      const [x0, x1] = around(place, place);
      return { type: "rect", xref: "x", yref: "paper", x0, x1, y0: 0, y1: 1, ...shade };
    });
    const layout = {
      shapes,
      margin: { l: 66, r: 14, t: 12, b: 46 },
      xaxis: report.axis(colours, dated ? "departure [UTC]" : "departure [h after the scenario's]", {
        anchor: axisName(rows - 1),
        range: around(places[0], places[places.length - 1]),
        ...(dated ? { type: "date" } : {}),
      }),
    };
    panels.forEach(([column, title], k) => {
      const top = 1 - k * (tall + gap);
      const place = { domain: [Math.max(top - tall, 0), top], automargin: false, nticks: 5 };
      const zero = column === "time_s" ? {} : { rangemode: "tozero" };
      layout[k ? `yaxis${k + 1}` : "yaxis"] = report.axis(colours, title, { ...place, ...zero });
    });
    return { data, layout, height: 70 + 135 * rows };
  };
  report.drawn(host, "What a departure comes to", draw, (_, begun) => {
    if (begun)
      host.on("plotly_click", ({ points }) => {
        if (!Number.isInteger(points[0].customdata)) return;
        report.mark(table, points[0].customdata);
        table.querySelector("tr.chosen").scrollIntoView({ block: "center", behavior: "smooth" });
      });
  });

  const table = report.table(
    all,
    [
      report.words(dated ? "departure, UTC" : "departure", moment, { key: (one) => one.departure_s }),
      report.words("feasible", (one) => (one.best ? "best" : one.feasible ? "yes" : "no"), {
        key: (one) => Number(one.feasible),
        class: (one) => (one.best ? "good-cell" : one.feasible ? "" : "bad-cell"),
      }),
      report.number(leg ? "travel time, s" : "time, s", "time_s"),
      leg ? report.number("length, m", "length_m") : report.number("tasks", "tasks"),
      leg ? report.number("clearance, m", "clearance_m") : report.number("priority", "total_priority", 1),
      powered && report.number("energy, Wh", "energy_wh"),
      report.number("current, m/s", "current_m_s", 2),
      !leg && report.words("waypoints", (one) => one.waypoints, { class: "long" }),
      feasible.length < departures.length && report.words("why not", (one) => one.reason, { class: "long" }),
    ],
    departures,
    "departures-table",
  );
  report.section("table", "Departures", null, table);
  report.provenance(provenance);
})();
