// The page of many missions: statistics, the paper's figures, and each mission by itself.

(function () {
  const study = report.data;
  const seeds = study.seeds;
  const cases = study.cases.map((one) => {
    return { ...one, legs: report.unpacked(one.legs, "mission", "expected", "executed") };
  });
  const swept = study.sweeps.map((sweep) => sweep.field);
  const caseName = (one, from = 0) =>
    swept.map((field, k) => `${field} = ${one.setting[k]}`).slice(from).join(", ");
  const state = { case: 0, mission: null };
  const now = () => cases[state.case];
  const followers = [];

  // --- figures of a mission ------------------------------------------------------------------------------

  const MEASURES = [
    ["t_mission", "mission time, s", 0],
    ["t_residual", "time left, s", 0],
    ["use", "use of the time, %", 1],
    ["tasks", "tasks", 0],
    ["total_priority", "total priority", 1],
    ["gap", "gap to the bound, %", 1],
    ["path_replans", "re-plans of paths", 0],
    ["mission_replans", "re-plans of the route", 0],
    ["cost_mission", "cost (Eq. 15)", 0],
    ["cost_total", "total cost (Eq. 16)", 0],
    ["collisions", "collisions", 0],
    ["faults", "faults", 0],
    ["coast_clearance", "to the coast, m", 0],
    ["obstacle_clearance", "to an obstacle, m", 0],
    ["seabed_altitude", "above the bed, m", 0],
    ["length", "way, m", 0],
    ["planning", "planning, s", 2],
  ].filter(([name]) => cases.some((one) => (one.figures[name] || []).some((value) => value !== null)));

  // --- head ----------------------------------------------------------------------------------------------

  const total = (name) => cases.reduce((sum, one) => sum + one.summary[name], 0);
  const [missions, onTime] = [total("missions"), total("on_time")];
  const rehearsal = study.rehearsal;
  const first = cases[0].summary;
  const mean = (name) => (first.figures[name] ? first.figures[name].mean : null);
  const what = rehearsal ? "rehearsal of a plan" : "study of simulated missions";
  const [low, high] = ["low", "high"].map((end) => report.fixed(first.on_time_percent[end], 1));
  const alone = cases.length === 1;
  const replans = mean("path_replans") + mean("mission_replans");
  const interval = alone ? `95 %: ${low} to ${high} %` : report.counted(cases.length, "setting");
  const rehearsed = rehearsal && `on time, of ${report.counted(rehearsal.missions, "mission")}`;
  report.head({
    title: study.name,
    badge: `${report.fixed(onTime)} of ${report.counted(missions, "mission")} on time`,
    good: onTime === missions,
    line: report.joined(" · ", what, `seeds ${study.provenance.seeds}`, study.description),
    tiles: [
      ["on time", `${report.fixed((100 * onTime) / missions, 1)} %`, interval],
      rehearsal && ["all planned tasks done", report.fixed(rehearsal.all_planned_tasks), rehearsed],
      alone && ["use of the time", `${report.fixed(mean("use_of_time_percent"), 1)} %`, "mean"],
      alone && ["total priority", report.figure(mean("total_priority"), 3), "mean of a mission"],
      alone && ["tasks", report.fixed(mean("tasks"), 1), "mean of a mission"],
      alone && ["re-plans", report.fixed(replans, 1), "of paths and route, mean"],
      ["collisions", report.fixed(total("collisions")), "found by the checker"],
      ["faults", report.fixed(total("faults")), "found by the checker"],
    ],
  });

  // --- choice of the setting -----------------------------------------------------------------------------

  if (!alone) {
    const change = () => {
      state.case = Number(list.value);
      state.mission = null;
      for (const follow of followers) follow();
    };
    const list = report.select({ id: "case", onchange: change }, cases.map((one, k) => [k, caseName(one)]));
    sweepSection(list);
  }

  /** The words that a list shows for its choice. */
  function words(choices, list) {
    return choices.find(([name]) => name === list.value)[1];
  }
  /** Mean of a figure, with its 95 % interval, over the values that a setting takes. */
  function sweepSection(list) {
    const names = study.described.filter(([name]) =>
      cases.some((one) => one.summary.figures[name] && report.isNumber(one.summary.figures[name].mean)),
    );
    const choices = [["on_time", "missions on time, %"], ...names];
    const host = element("div", { id: "sweep" });
    const measure = report.select({ id: "sweep-measure", onchange: () => figure.draw() }, choices);
    report.section(
      "settings",
      "Settings compared",
      "Means with 95 % intervals. The setting that is chosen here is shown in all that follows.",
      element("div.choices", element("label", "Figure", measure), element("label", "Shown below", list)),
      host,
    );
    const of = (one) => {
      const { on_time_percent, figures } = one.summary;
      const { share, mean, low, high } = measure.value === "on_time" ? on_time_percent : figures[measure.value] || {};
      return [share ?? mean ?? null, low ?? null, high ?? null];
    };
    const figure = report.drawn(host, "Settings compared", (colours, width) => {
      const [inner, lines] = [study.sweeps[0].values, new Map()];
      for (const one of cases)
        lines.set(caseName(one, 1), [...(lines.get(caseName(one, 1)) || []), one]);
      const numeric = inner.every(report.isNumber);
      const hues = ["plan", "earlier", "task", "static", "afloat", "route"].map((name) => colours[name]);
      const marks = ["circle", "square", "diamond", "triangle-up", "cross", "x"];
      return {
        height: 340,
        data: [...lines].map(([name, members], k) => {
          const [values, low, high] = [0, 1, 2].map((part) => members.map((one) => of(one)[part]));
          const color = hues[k % hues.length];
          const x = members.map((one) => (numeric ? one.setting[0] : report.literal(one.setting[0])));
          return report.points(x, values, {
            mode: "lines+markers",
            name: report.literal(name),
            error_y: report.errors(values, low, high, { width: 5, thickness: 1.4 }),
            line: { color, width: 1.6 },
            marker: { symbol: marks[k % marks.length], size: 9, color },
            hovertemplate: "%{y:,.4g}<extra>%{x}</extra>",
          });
        }),
        layout: {
          ...report.legendAbove,
          showlegend: lines.size > 1,
          margin: { l: 64, r: 14, t: lines.size > 1 ? 40 : 12, b: 46 },
          xaxis: report.axis(colours, report.literal(swept[0]), numeric ? { tickvals: inner } : { type: "category" }),
          yaxis: report.axis(colours, width < 500 ? "" : words(choices, measure)),
        },
      };
    });
  }

  // --- statistics ----------------------------------------------------------------------------------------

  if (rehearsal) {
    const plan = rehearsal.plan;
    const columns = [
      report.words("task", (job) => job.name, { class: "long", key: (job) => job.name }),
      report.yesNo("planned", (job) => job.planned),
      report.number("done in", "done"),
      report.number("share, %", (job) => (100 * job.done) / rehearsal.missions, 1),
      report.number("earned of it, %", (job) => (job.share == null ? null : 100 * job.share), 1),
    ];
    const title = `Tasks in ${report.counted(rehearsal.missions, "simulated mission")}`;
    const [tasks, priority] = [report.counted(plan.tasks, "task"), report.figure(plan.total_priority, 3)];
    const planned = `Planned: ${tasks} of total priority ${priority} in ${report.hours(plan.time_s)}.`;
    const jobs = report.table(title, columns, rehearsal.jobs, "jobs-table");
    report.section("plan", "The plan and what became of it", planned, jobs);
  }

  const statistics = element("div");
  report.section("statistics", "Statistics", null, statistics);
  follow(() => {
    const { summary } = now();
    const described = study.described.map(([name, words]) => [words, summary.figures[name]]);
    const rows = described.filter(([, found]) => found && report.isNumber(found.mean));
    const legs = summary.expected_against_executed;
    const failed = summary.failed_seeds.map((seed, k) => `seed ${seed} (${summary.failures[k]})`);
    const cell = (name) => ({
      title: { low: "from", high: "to", q05: "5 %", q95: "95 %" }[name] || name,
      text: ([, found]) => report.figure(found[name]),
    });
    const three = (value) => report.figure(value, 3);
    const words = [
      legs.correlation !== null &&
        `Correlation of executed with expected times of legs ${report.fixed(legs.correlation, 4)} over ` +
          `${report.counted(legs.legs, "leg")}; median relative error ` +
          `${three(legs.median_relative_error_percent)} % (95 %: ${three(legs.low)} to ${three(legs.high)} %).`,
      failed.length && `Failed: ${failed.slice(0, 20).join("; ")}${failed.length > 20 ? "; …" : ""}.`,
    ].filter(Boolean);
    const share = `${report.fixed(summary.on_time)} of ${report.counted(summary.missions, "mission")} on time`;
    const title = report.joined(": ", !alone && caseName(now()), share);
    const figures = ["mean", "low", "high", "q05", "median", "q95"].map(cell);
    const columns = [report.words("figure", ([name]) => name, { class: "long" }), ...figures];
    statistics.replaceChildren(
      report.table(`${title}; means with 95 % intervals, and quantiles`, columns, rows, "statistics-table"),
      ...words.map((text) => report.remark(text)),
    );
  });

  /** Call now, and whenever another setting is chosen. */
  function follow(action) {
    followers.push(action);
    action();
  }
  function figure(id, title, note, draw, after) {
    const host = element("div", { id });
    report.section(`${id}-section`, title, note, host);
    const made = report.drawn(host, title, draw, after);
    followers.push(() => made.draw());
  }
  const clicks = (host, begun) => {
    if (begun)
      host.on("plotly_click", ({ points }) => {
        const number = points[0].customdata;
        if (Number.isInteger(number)) choose(number, true);
      });
  };

  // --- the paper's figures -------------------------------------------------------------------------------

  const numbers = () => seeds.map((_, k) => k);
  const size = () => Math.min(Math.max(420 / seeds.length, 3.5), 8);
  /** An axis of the seeds of the first missions, or of all. */
  const seedAxis = (colours, more, count = seeds.length, every = Math.max(1, Math.ceil(count / 20))) => {
    const tickvals = numbers().filter((k) => k < count && k % every === 0);
    const ticktext = tickvals.map((k) => String(seeds[k]));
    const shown = { tickvals, ticktext, range: [-0.8, count - 0.2], showgrid: false };
    return report.axis(colours, "seed of the mission", { ...shown, ...more });
  };

  /** Points of the missions on time and of those that failed, with the seed under the pointer. */
  const groups = (colours, x, y, hover, more = () => ({})) =>
    [
      [true, "on time", colours.plan, "circle"],
      [false, "failed", colours.earlier, "x"],
    ].map(([wanted, name, color, symbol]) => {
      const chosen = numbers().filter((k) => now().success[k] === wanted);
      return report.points(chosen.map(x), chosen.map(y), {
        name,
        customdata: chosen,
        text: chosen.map(seedName),
        marker: { color, symbol, size: size(), ...more(chosen) },
        hovertemplate: `%{text}<br>${hover}<extra></extra>`,
      });
    });
  const seedName = (k) => `seed ${seeds[k]}`;

  figure(
    "time-use",
    "Time of each mission (Fig. 12)",
    "Above the time that a mission took, and the time available; below what was left. A click shows the mission.",
    (colours) => {
      const { figures, success } = now();
      const available = { color: colours.bad, width: 2, shape: "hvh" };
      const zero = { zeroline: true, zerolinecolor: colours.line };
      return {
        height: 440,
        data: [
          report.line(numbers(), figures.t_available, available, { name: "time available" }),
          ...groups(colours, (k) => k, (k) => figures.t_mission[k], "%{y:,.0f} s"),
          {
            ...{ type: "bar", yaxis: "y2", name: "time left", showlegend: false },
            x: numbers(),
            y: figures.t_residual,
            customdata: numbers(),
            marker: { color: numbers().map((k) => (success[k] ? colours.plan : colours.earlier)) },
            text: numbers().map(seedName),
            textposition: "none",
            hovertemplate: "%{text}<br>%{y:,.0f} s left<extra></extra>",
          },
        ],
        layout: {
          ...report.legendAbove,
          margin: { l: 66, r: 14, t: 34, b: 46 },
          bargap: 0.25,
          xaxis: seedAxis(colours, { anchor: "y2" }),
          yaxis: report.axis(colours, "mission time [s]", { domain: [0.46, 1], automargin: false }),
          yaxis2: report.axis(colours, "time left [s]", { domain: [0, 0.38], automargin: false, ...zero }),
        },
      };
    },
    clicks,
  );

  const BOXES = 25;
  figure(
    "expected-times",
    "Expected and executed times of legs (Fig. 13)",
    `Travel times without tasks: boxes of the legs of ${seeds.length > BOXES ? `the first ${BOXES} missions` : "each mission"}, and every leg of all missions.`,
    (colours, width) => {
      const { mission, expected, executed } = now().legs;
      const wide = width > 760;
      const few = Array.from(mission.keys()).filter((k) => mission[k] < BOXES);
      const box = (values, name, colour, offset) => ({
        type: "box",
        name,
        x: few.map((k) => mission[k]),
        y: few.map((k) => values[k]),
        offsetgroup: offset,
        marker: { color: colour, size: 3 },
        line: { width: 1.2 },
        fillcolor: report.mix(colour, 0.35),
        hoverinfo: "y",
      });
      const [least, most] = [Math.min, Math.max].map((of) => of(...expected, ...executed));
      const opacity = Math.min(0.8, Math.max(0.2, 6 / Math.max(mission.length, 1) ** 0.45));
      const count = Math.min(seeds.length, BOXES);
      const right = { xaxis: "x2", yaxis: "y2", showlegend: false };
      const equal = { color: colours.quiet, dash: "dash", width: 1.2 };
      const low = { automargin: false };
      return {
        height: wide ? 430 : 760,
        data: [
          box(expected, "expected", colours.plan, "a"),
          box(executed, "executed", colours.afloat, "b"),
          report.line([least, most], [least, most], equal, right),
          report.points(Array.from(expected), Array.from(executed), {
            ...right,
            customdata: Array.from(mission),
            marker: { color: colours.plan, size: 5, opacity },
            text: Array.from(mission, seedName),
            hovertemplate: "%{text}<br>expected %{x:,.0f} s, executed %{y:,.0f} s<extra></extra>",
          }),
        ],
        layout: {
          boxmode: "group",
          ...report.legendAbove,
          xaxis: seedAxis(colours, { domain: wide ? [0, 0.6] : [0, 1], range: [-0.7, count - 0.3] }, count, 1),
          yaxis: report.axis(colours, "travel time of a leg [s]", { domain: wide ? [0, 1] : [0.58, 1], ...low }),
          xaxis2: report.axis(colours, "expected [s]", { domain: wide ? [0.7, 1] : [0, 1], anchor: "y2" }),
          yaxis2: report.axis(colours, "executed [s]", { domain: wide ? [0, 1] : [0, 0.44], anchor: "x2", ...low }),
        },
      };
    },
    clicks,
  );

  figure(
    "planning-time",
    "Time of planning (Fig. 14)",
    "Wall-clock seconds on a logarithmic scale: all planning of a mission, and its single path planning calls, median with 5 to 95 %.",
    (colours) => {
      const one = now();
      const [low, middle, high] = [0, 1, 2].map((k) => one.calls.map((row) => row[k]));
      const marks = (name, y, color, symbol, more) =>
        report.points(numbers(), y, {
          name,
          customdata: numbers(),
          marker: { color, size: size(), symbol },
          text: numbers().map(seedName),
          hovertemplate: "%{text}<br>%{y:.3g} s<extra></extra>",
          ...more,
        });
      const whole = one.figures.planning.map((value) => value || null);
      const spread = report.errors(middle, low, high, { color: colours.moving, thickness: 1.4, width: 0 });
      return {
        height: 360,
        data: [
          marks("all planning of the mission", whole, colours.earlier, "square"),
          marks("a path planning call, median", middle, colours.plan, "circle", { error_y: spread }),
        ],
        layout: {
          ...report.legendAbove,
          xaxis: seedAxis(colours),
          yaxis: report.logAxis(colours, "time of planning [s]", [...one.figures.planning, ...low, ...high], {
            automargin: false,
          }),
        },
      };
    },
    clicks,
  );

  // --- missions ------------------------------------------------------------------------------------------

  const scatter = element("div", { id: "scatter" });
  const pick = (id, chosen) => report.select({ id, onchange: () => cloud.draw() }, MEASURES, chosen);
  const [across, up] = [pick("across", "t_residual"), pick("up", "total_priority")];
  const table = element("div");
  const pair = element("div.choices", element("label", "Across", across), element("label", "Up", up));
  report.section("missions", "Missions", "A click on a point or a seed shows the mission below.", pair, scatter, table);
  const cloud = report.drawn(
    scatter,
    "Missions, one figure against another",
    (colours) => {
      const of = (list) => (k) => now().figures[list.value][k];
      return {
        height: 360,
        data: groups(colours, of(across), of(up), "%{x:,.4g}, %{y:,.4g}", (chosen) => ({
          size: chosen.map((k) => (k === state.mission ? 15 : 8)),
          line: { color: colours.text, width: chosen.map((k) => (k === state.mission ? 2 : 0)) },
        })),
        layout: {
          ...report.legendAbove,
          xaxis: report.axis(colours, words(MEASURES, across)),
          yaxis: report.axis(colours, words(MEASURES, up)),
        },
      };
    },
    clicks,
  );
  follow(() => {
    const one = now();
    const open = (k) => {
      const seed = { "data-seed": seeds[k] };
      return report.link(`Show the mission of seed ${seeds[k]}`, String(seeds[k]), () => choose(k, true), seed);
    };
    const columns = [
      { title: "seed", key: (k) => seeds[k], text: open },
      report.words("outcome", (k) => (one.success[k] ? "on time" : "failed"), {
        key: (k) => Number(one.success[k]),
        class: (k) => (one.success[k] ? "good-cell" : "bad-cell"),
      }),
      ...MEASURES.map(([name, words, decimals]) => report.number(words, (k) => one.figures[name][k], decimals)),
    ];
    const title = report.joined(", ", report.counted(seeds.length, "mission"), !alone && caseName(one));
    table.replaceChildren(report.table(title, columns, numbers(), "missions-table"));
    if (cloud.made) cloud.draw();
  });

  // --- one mission ---------------------------------------------------------------------------------------

  const detail = element("div", { id: "mission", tabindex: "-1" });
  const part = report.section("mission-section", "One mission", null, detail);
  let route = null;

  function choose(number, scroll) {
    state.mission = number;
    const [one, seed] = [now(), seeds[number]];
    report.mark(table, number);
    cloud.draw();
    const mission = one.missions[number];
    const figures = MEASURES.map(([name, words, decimals]) => {
      return [words, report.fixed(one.figures[name][number], decimals)];
    });
    const facts = [["outcome", one.reason[number]], ...figures];
    const title = report.joined(", ", `Seed ${seed}`, cases.length > 1 && caseName(one));
    const columns = report.pair(report.facts("Figures", facts), ways(one, number, seed));
    detail.replaceChildren(element("h3", { id: "mission-title" }, title), columns);
    if (mission) {
      const host = element("div.map", { id: "route" });
      const routes = mission.routes.map(([cause, made], k) => {
        return [k, k ? `route R${k} at ${report.fixed(made)} s, ${cause}` : "first route"];
      });
      const change = { id: "route-made", onchange: () => route.figure.draw() };
      const list = report.select(change, [["-1", "way taken"], ...routes]);
      const columns = [
        { title: "leg", key: (leg) => mission.legs.indexOf(leg), text: (_, k) => String(k + 1) },
        report.words("from → to", ([from, to]) => `${from} → ${to}`),
        report.number("expected, s", 2),
        report.number("executed, s", 3),
        report.number("task, s", 4),
        report.weight("priority", (leg) => leg[5], "–"),
        report.number("re-plans", 6),
        report.yesNo("reached", (leg) => leg[7] === 1, true),
      ];
      const plans = [
        report.words("route", (_, k) => (k ? `R${k}` : "first")),
        report.words("cause", ([cause]) => cause),
        { title: "made at, s", text: (route) => report.fixed(route[1]) },
        { title: "expected, s", text: (route) => report.fixed(route[2]) },
        { title: "priority", text: (route) => report.figure(route[3], 3) },
        report.words("waypoints", (route) => route[4].join(" → "), { class: "long" }),
      ];
      const straight = report.remark("Straight lines between waypoints: a study keeps no tracks.");
      const shown = [element("div.choices", element("label", "Shown", list)), host, straight];
      const count = report.counted(mission.legs.length, "leg");
      const beside = report.pair(shown, report.table(count, columns, mission.legs, "mission-legs"));
      beside.style.marginTop = "1.1rem";
      detail.append(beside, report.table("Routes", plans, mission.routes, "mission-routes"));
      route = study.map && routeMap(host, list, mission);
    }
    if (!scroll) return;
    part.scrollIntoView({ behavior: "smooth", block: "start" });
    detail.focus({ preventScroll: true });
  }

  /** How to come by the whole of a mission. */
  function ways(one, number, seed) {
    const name = `${String(state.case).padStart(4, "0")}-${String(seed).padStart(8, "0")}`;
    const quoted = (text) => (/^[\w.,=+-]*$/.test(text) ? text : `'${text.replace(/'/g, "'\\''")}'`);
    const changed = swept.map((field, k) => `${field}=${JSON.stringify(one.setting[k])}`);
    const settings = [...study.changes, ...changed].map((text) => `--set ${quoted(text)}`);
    const what = ["auvplan mission", study.scenario || "SCENARIO.yaml", `--seed ${seed}`];
    const again = [...what, ...settings, `--out out/seed-${seed}`].join(" ").split(" ");
    const whole = (word, k) => [k ? " " : null, element("span", { style: "white-space: nowrap" }, word)];
    const saved = [
      element("p", "It is saved in this folder. Its page, with map and track, is written by"),
      element("pre.code", `auvplan report runs/${name}`),
    ];
    const kept = study.runs.includes(name);
    const which = study.scenario ? "" : " (SCENARIO.yaml is the study's scenario)";
    const verb = kept ? "Or simulate" : "Simulate";
    return [
      element("h3", "The whole mission"),
      kept ? saved : null,
      element("p", `${verb} it again, with its track, its pictures and its page${which}:`),
      element("pre.code", { id: "again" }, again.map(whole)),
    ];
  }

  function routeMap(host, list, mission) {
    const places = report.unpack(mission.waypoints);
    const place = (node) => [places[3 * node], places[3 * node + 1]];
    const count = places.length / 3;
    const begun = mission.legs.length ? mission.legs[0][0] : 0;
    const way = [begun, ...mission.legs.filter((leg) => leg[7] === 1).map((leg) => leg[1])];
    const labels = Array.from({ length: count }, (_, node) => {
      const [[north, east], passed] = [place(node), way.includes(node)];
      return { text: String(node), north, east, rank: passed ? 1 : 2, colour: passed ? "text" : "quiet" };
    });
    const traces = (colours, { unit }) => {
      const route = Number(list.value);
      const nodes = route < 0 ? way : mission.routes[route][4];
      const until = route < 0 ? [] : way.slice(0, Math.max(way.lastIndexOf(nodes[0]) + 1, 0));
      const at = (chosen, more) => {
        const [x, y] = [1, 0].map((axis) => chosen.map((node) => place(node)[axis] / unit));
        return report.points(x, y, { hoverinfo: "skip", ...more });
      };
      const line = (chosen, name, color) => {
        const marker = { symbol: "arrow", angleref: "previous", size: 11, color };
        return at(chosen, { mode: "lines+markers", name, line: { color, width: 2 }, marker });
      };
      const end = (node, color, symbol, size) =>
        at([node], { marker: { symbol, size, color, line: { color: "#000000", width: 1 } } });
      const every = Array.from({ length: count }, (_, node) => node);
      const open = { size: 6, color: colours.card, line: { color: colours.quiet, width: 1.3 } };
      return [
        at(every, { name: "waypoints", marker: { symbol: "circle", ...open } }),
        line(until, "executed before", colours.left),
        line(nodes, route < 0 ? "executed" : "route", route < 0 ? colours.track : colours.plan),
        end(nodes[0], colours.start, "circle", 11),
        end(nodes[nodes.length - 1], colours.task, "star", 15),
      ];
    };
    return report.map(host, "Route of the mission", study.map, traces, labels);
  }

  /** The mission that is shown at first: the first that failed, or the first of all. */
  follow(() => choose(Math.max(now().success.indexOf(false), 0), false));

  report.provenance(study.provenance);
})();
