// The page of one mission, one plan or one leg.

(function () {
  const run = report.data;
  const TRACK = ["time", "north", "east", "depth", "coast", "closed", "bed", "obstacle"];
  const track = report.unpacked(run.track, ...TRACK);
  const waypoints = run.waypoints;
  const obstacles = run.legs.map((leg) => report.unpacked(leg.obstacles, "times", "places"));
  const plans = run.plans.map((plan) => report.unpacked(plan, "places", "times"));
  const current = report.unpacked(run.current, "u", "v");
  const section = report.unpacked(run.section, "times", "along");
  const state = { time: run.begin, axis: "time", playing: false };
  const since = (time) => time - run.begin;
  const CAUSES = {
    leg: "at departure",
    window: "window",
    hazard: "hazard",
    start: "first route",
    late: "late",
    early: "early",
    refused: "leg refused",
    charge: "charge",
    spare: "charge to spare",
  };

  // --- what holds at a time --------------------------------------------------------------------------

  /** The last index whose value is no later than a time, -1 before the first. */
  function latest(values, time) {
    let [low, high] = [0, values.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] <= time + 1e-6) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  /** Index and share of the step in which a time lies; the first or the last value holds beyond the ends. */
  function step(times, time) {
    const k = latest(times, time);
    if (k < 0) return [0, 0];
    if (k >= times.length - 1) return [times.length - 1, 0];
    return [k, (time - times[k]) / Math.max(times[k + 1] - times[k], 1e-9)];
  }
  const between = (values, [k, share], width = 1, offset = 0) => {
    const here = values[k * width + offset];
    return share ? here + share * (values[(k + 1) * width + offset] - here) : here;
  };

  /** Where the vehicle is, what is near, its speed over ground and its course. */
  function vehicle(time) {
    if (!track.time.length) {
      const [north, east, depth] = waypoints[run.start].place;
      return { north, east, depth, speed: 0, course: 0 };
    }
    const at = step(track.time, time);
    const k = Math.min(at[0], Math.max(track.time.length - 2, 0));
    const change = (name) => (track[name][k + 1] ?? track[name][k]) - track[name][k];
    const [dt, dn, de, dd] = ["time", "north", "east", "depth"].map(change);
    const moved = Math.hypot(dn, de);
    return {
      ...Object.fromEntries(TRACK.map((name) => [name, track[name] ? between(track[name], at) : null])),
      speed: dt > 0 ? Math.hypot(moved, dd) / dt : 0,
      course: moved > 0 ? (Math.atan2(de, dn) * 180) / Math.PI : 0,
    };
  }

  /** Number of the leg that is executed at a time, or was last; -1 before the first. */
  const legAt = (time) => run.legs.findLastIndex((leg) => leg.begin !== null && leg.begin <= time + 1e-6);

  /** A least distance in metres: to the coast no finer than it is known. */
  const distance = (name, value) =>
    name === "coast" ? report.clearance(value, run.accuracy, run.reach) : report.clearance(value);

  const nodeName = (node) => waypoints[node].name;
  const legName = (leg) => `${nodeName(leg.from)} → ${nodeName(leg.to)}`;
  const moments = run.doing.map(([moment]) => moment);
  function doing(time) {
    const number = latest(moments, time);
    return number < 0 ? (run.legs.length ? "not under way yet" : "no leg was begun") : run.doing[number][1];
  }

  /** The plan that is followed at a time, and all others made until then, as numbers in `plans`. */
  function plansAt(time) {
    const number = legAt(time);
    const made = [...plans.keys()].filter((k) => plans[k].made <= time + 1e-6 && plans[k].leg <= number);
    const own = [...plans.keys()].filter((k) => plans[k].leg === number);
    const followed = number < 0 ? [] : run.legs[number].followed.map((k) => own[k]);
    const now = followed.filter((k) => made.includes(k)).at(-1) ?? -1;
    return { now, earlier: made.filter((k) => k !== now) };
  }

  const routeAt = (time) => run.routes.findLast((route) => route.made <= time + 1e-6);

  /** Obstacles at a time with their collision boundaries: { kind, north, east, radius, boundary }. */
  function obstaclesAt(time) {
    const number = legAt(time);
    const found = run.known.map(({ position, velocity, radius }) => {
      const [north, east] = [0, 1].map((axis) => position[axis] + velocity[axis] * time);
      return { kind: "known", north, east, radius, boundary: radius };
    });
    const own = obstacles[number];
    if (!own || !own.places) return found;
    const [count, at] = [own.kinds.length, step(own.times, time)];
    own.kinds.forEach((kind, m) => {
      const [north, east] = [0, 1].map((axis) => between(own.places, at, 3 * count, 3 * m + axis));
      const radius = own.radii[m];
      found.push({ kind, north, east, radius, boundary: radius + grown(number, own.looks[m], time) });
    });
    return found;
  }

  /** What the boundary of an obstacle allows for: the error of the last look and the growth since, m. */
  function grown(number, looks, time) {
    const rule = run.sensing;
    if (!rule) return 0;
    const last = latest(looks, time);
    const [error, seen] = last < 0 ? [rule.prior, run.legs[number].begin] : [rule.seen, looks[last]];
    const until = Math.min(time, run.legs[number].end);
    return error + Math.min(rule.growth * Math.max(until - seen, 0), rule.growth_max);
  }

  // --- head ------------------------------------------------------------------------------------------

  const figures = run.figures;
  const leg = run.simulated ? "simulated leg" : "planned leg";
  const kind = { mission: "simulated mission", plan: "plan", leg }[run.kind];
  const start = report.utc(0, run.epoch);
  const whole = run.kind !== "leg";
  const { path_replans, mission_replans, priority_bound } = figures;
  const sum = (name) => run.legs.reduce((total, leg) => total + leg[name], 0);
  const begun = run.legs.filter((leg) => leg.begin !== null);
  const of = (name) => report.fixed(figures[name]);
  const most = priority_bound ? `at most ${report.figure(priority_bound, 3)} possible` : null;
  const replans = whole ? `${path_replans} of paths, ${mission_replans} of the route` : "of the path";
  const hit = figures.collisions ? "points inside an obstacle or on land" : "none on the track";
  const left = run.energy && run.energy.charge_end !== undefined ? run.energy.charge_end : null;
  const charge = left === null ? "no battery is known" : `charge ${report.fixed(100 * left)} % at the end`;
  const [low, high] = run.promise ? [run.promise.low, run.promise.high] : [0, 1];
  const sure = run.promise && `${report.fixed(100 * low, 1)} to ${report.fixed(100 * high, 1)} % of drawn seas`;
  report.head({
    title: run.name,
    badge: run.reason || (run.success ? "in time" : "failed"),
    good: run.success,
    line: report.joined(" · ", `${kind}, seed ${run.seed}`, start && `departure ${start}`, run.description),
    tiles: [
      ["mission time", report.hours(figures.t_mission), `${of("t_mission")} of ${of("t_available")} s`],
      ["time left", report.hours(figures.t_residual), `${of("t_residual")} s`],
      whole && [run.simulated ? "tasks done" : "tasks", of("tasks"), report.counted(waypoints.length, "waypoint")],
      whole && ["total priority", report.figure(figures.total_priority, 3), most],
      ["distance", `${report.fixed(sum("length") / 1000, 1)} km`, report.counted(begun.length, "leg")],
      run.promise && ["home in time", `${report.fixed(100 * run.promise.share, 1)} %`, sure],
      run.energy && ["energy", `${report.fixed(run.energy.total_wh)} Wh`, charge],
      run.simulated && ["re-plans", report.fixed(path_replans + mission_replans), replans],
      run.simulated && ["collisions", of("collisions"), hit],
    ],
    warnings: [...run.warnings, ...run.provenance.assumed],
  });

  // --- map -------------------------------------------------------------------------------------------

  /** Colours of the kinds of obstacles. */
  const COLOUR = { static: "static", afloat: "afloat", "self-motivated": "moving", known: "known" };
  const present = Object.entries(COLOUR).filter(([name]) =>
    name === "known" ? run.known.length : run.legs.some((leg) => leg.obstacles.kinds.includes(name)),
  );
  const replanned = run.routes.filter((route) => route.made !== undefined).slice(1);

  function swatch(shape, colour) {
    const bar = (more) => ["line", { x1: 1, y1: 8, x2: 27, y2: 8, "stroke-width": 1.8, ...more }];
    const parts = {
      line: [bar({ "stroke-width": 3 })],
      thin: [bar({ "stroke-width": 1.6 })],
      dash: [bar({ "stroke-dasharray": "5 3" })],
      dot: [bar({ "stroke-dasharray": "2 3" })],
      arrow: [
        ["line", { x1: 3, y1: 8, x2: 22, y2: 8, "stroke-width": 1.6 }],
        ["path", { d: "M18 4 L24 8 L18 12", fill: "none", "stroke-width": 1.6 }],
      ],
      area: [["rect", { x: 3, y: 2, width: 22, height: 12, rx: 2, stroke: "none" }]],
      ring: [["circle", { cx: 14, cy: 8, r: 6, fill: "none", "stroke-width": 1.6, "stroke-dasharray": "2 2" }]],
      disc: [["circle", { cx: 14, cy: 8, r: 6, stroke: "none" }]],
      halo: [["circle", { cx: 14, cy: 8, r: 7, "fill-opacity": 0.25, "stroke-dasharray": "2 2" }]],
      text: [["path", { d: "M9 13 L14 3 L19 13 M11 9.5 H17", fill: "none", "stroke-width": 1.6 }]],
      square: [["rect", { x: 8, y: 2, width: 12, height: 12, fill: "none", "stroke-width": 2 }]],
    }[shape];
    const style = `stroke: var(--${colour}); fill: var(--${colour})`;
    const frame = { width: 28, height: 16, viewBox: "0 0 28 16", "aria-hidden": "true", style };
    return element("svg", frame, parts.map((part) => element(...part)));
  }

  const open = run.closures.some(({ spans }) => spans[0][0] > -1e8);
  const turns = run.promise?.turns ?? [];
  const layers = [
    run.map.chart && ["chart", run.map.chart.uncertain ? "coast, uncertain area" : "coast", "area", "coast"],
    run.closures.length && ["closures", open ? "closed areas, dashed while open" : "closed areas", "area", "closed"],
    run.map.depths && ["depths", "depth of the sea bed, m", "thin", "depth"],
    current && ["current", "current", "arrow", "current"],
    run.kind !== "leg" && run.routes.length > 1 && ["route", "route, to come", "dot", "route"],
    ["plan", "plan that is followed", "line", "plan"],
    run.simulated && plans.length && ["earlier", "earlier plans", "dash", "earlier"],
    ["track", run.simulated ? "track" : "whole way", "line", "track"],
    present.length && ["obstacles", "obstacles", "disc", present[0][1]],
    run.simulated && present.length && ["boundary", "their uncertainty boundaries", "halo", "quiet"],
    run.sensing && present.length && ["sensed", "sensed range", "ring", "sense"],
    turns.length && ["late", "paths if late", "dash", "earlier"],
    replanned.length && ["replans", "route re-planned", "square", "earlier"],
    ["waypoints", "waypoints", "disc", "task"],
    ["names", "names", "text", "text"],
  ].filter(Boolean);

  /** Whether the map is as small as on a telephone, where marks are fewer and smaller. */
  const narrow = () => stage.clientWidth > 0 && stage.clientWidth < 480;
  const HEAD = 0.32;
  /** The arrows of the current at a time; the longest are about as long as the arrows are apart. */
  function arrows(time, x, y, every) {
    if (!current) return "";
    const frame = Math.max(latest(current.times, time), 0);
    const [rows, columns] = [current.north.length, current.east.length];
    const apart = Math.min(
      Math.abs(x(current.east[1]) - x(current.east[0])),
      Math.abs(y(current.north[1]) - y(current.north[0])),
    );
    const scale = (0.92 * every * apart) / Math.max(current.fastest, 1e-6);
    const parts = [];
    const place = (px, py) => `${px.toFixed(1)} ${py.toFixed(1)}`;
    for (let i = every >> 1; i < rows; i += every) {
      for (let j = every >> 1; j < columns; j += every) {
        const k = (frame * rows + i) * columns + j;
        if (current.u[k] < -30) continue;
        const part = scale * Math.min(1, current.fastest / Math.hypot(current.u[k], current.v[k]));
        const [dx, dy] = [current.v[k] * part, -current.u[k] * part];
        const [tx, ty] = [x(current.east[j]) + dx / 2, y(current.north[i]) + dy / 2];
        const wing = (side) => place(tx - HEAD * (dx - side * 0.6 * dy), ty - HEAD * (dy + side * 0.6 * dx));
        const tip = place(tx, ty);
        parts.push(`M${place(tx - dx, ty - dy)}L${tip}M${wing(1)}L${tip}L${wing(-1)}`);
      }
    }
    return parts.join("");
  }

  /** A broken line through places: `at(k)` returns east and north, m. */
  function line(count, at, x, y) {
    const parts = [];
    let before = "";
    for (let k = 0; k < count; k++) {
      const [e, n] = at(k);
      const place = `${x(e).toFixed(1)} ${y(n).toFixed(1)}`;
      if (place !== before) parts.push(place);
      before = place;
    }
    return parts.length ? `M${parts.join("L")}` : "";
  }

  /** How what the map paints is drawn: colour and width of its line, and what differs from a plain line. */
  const PENS = {
    current: ["current", 1],
    closure: ["closed", 1.4, "fill: var(--closed); fill-opacity: 0.35"],
    open: ["closed", 1.4, "fill: var(--closed); fill-opacity: 0.06; stroke-dasharray: 5 4"],
    route: ["route", 1.6, "stroke-dasharray: 1.5 4"],
    way: ["track", 1.4, "opacity: 0.4"],
    earlier: ["earlier", 1.3, "stroke-dasharray: 7 5"],
    late: ["earlier", 1.3, "stroke-dasharray: 7 5"],
    executed: ["track", 2.6],
    plan: ["plan", 2.8],
    boundary: ["quiet", 1, "fill: var(--quiet); fill-opacity: 0.2; stroke-dasharray: 2 3"],
    obstacle: ["quiet", 1.2, "fill-opacity: 0.65"],
    sensed: ["sense", 1.5, "stroke-dasharray: 2 4"],
    replan: ["earlier", 1.9, "stroke-linejoin: miter"],
    vehicle: ["halo", 1.5, "fill: var(--earlier)"],
  };
  /** What the map shows of a time, from the lowest to the highest. */
  function painted(x, y) {
    const [{ time }, { hidden }] = [state, state.map];
    const [here, all] = [vehicle(time), obstaclesAt(time)];
    const [small, pixels] = [narrow() ? 0.72 : 1, Math.abs(x(1) - x(0))];
    const made = [];
    const show = (layer, tag, name, { style: own = "", ...attributes }) => {
      const [colour, width, more = ""] = PENS[name.split(" ").at(-1)];
      const style = `stroke: var(--${colour}); stroke-width: ${width}; ${more}; ${own}`;
      if (!hidden.has(layer)) made.push(element(tag, { class: name, style, ...attributes }));
    };
    const node = (chosen) => (k) => [waypoints[chosen[k]].place[1], waypoints[chosen[k]].place[0]];
    const plan = (k) =>
      line(plans[k].places.length / 3, (s) => [plans[k].places[3 * s + 1], plans[k].places[3 * s]], x, y);
    show("current", "path", "current", { d: arrows(time, x, y, narrow() ? 2 : 1) });

    for (const { name, spans, rings } of run.closures) {
      const closed = spans.some(([begins, ends]) => begins <= time && time < ends);
      const ring = (places) => line(places.length, (k) => [places[k][1], places[k][0]], x, y) + "z";
      show("closures", "path", closed ? "closure" : "closure open", { d: rings.map(ring).join("") });
      const longest = rings.reduce((one, other) => (other.length > one.length ? other : one), []);
      const mean = (axis) => longest.reduce((sum, place) => sum + place[axis], 0) / longest.length;
      if (longest.length && !hidden.has("closures") && !hidden.has("names"))
        made.push(element("text.closure-name", { x: x(mean(1)), y: y(mean(0)) }, name));
    }

    const [number, rest] = [legAt(time), routeAt(time)?.nodes ?? []];
    const target = number < 0 ? run.start : run.legs[number].to;
    const coming = rest.includes(target) ? rest.slice(rest.indexOf(target)) : rest;
    for (const { positions } of turns)
      show("late", "path", "late", { d: line(positions.length, (k) => [positions[k][1], positions[k][0]], x, y) });
    if (run.kind !== "leg" && run.simulated)
      show("route", "path", "route", { d: line(coming.length, node(coming), x, y) });

    const way = (count) => line(count, (k) => [track.east[k], track.north[k]], x, y);
    show("track", "path", "way", { d: way(track.time.length) });
    const { now: followed, earlier } = plansAt(time);
    show("earlier", "path", "earlier", { d: earlier.map(plan).join("") });
    const done = track.time.length ? way(latest(track.time, time) + 1) : "";
    const on = done && `L${x(here.east).toFixed(1)} ${y(here.north).toFixed(1)}`;
    show("track", "path", "executed", { d: done + on });
    show("plan", "path", "plan", { d: followed < 0 ? "" : plan(followed) });

    const disc = (layer, name, { east, north }, radius, more) => {
      const place = { cx: x(east).toFixed(2), cy: y(north).toFixed(2), r: (radius * pixels).toFixed(2) };
      show(layer, "circle", name, { ...place, ...more });
    };
    const told = (one) => ({ "data-east": one.east, "data-north": one.north });
    for (const one of all)
      if (one.boundary > one.radius)
        disc("boundary", "boundary", one, one.boundary, { "data-radius": one.boundary });
    for (const one of all) {
      const colour = `var(--${COLOUR[one.kind] || "quiet"})`;
      const style = `fill: ${colour}; stroke: ${colour}`;
      disc("obstacles", "obstacle", one, one.radius, { ...told(one), style });
    }
    if (run.sensing && number >= 0) disc("sensed", "sensed", here, run.sensing.range);
    const remade = [...new Set(replanned.filter((one) => one.made <= time + 1e-6).map((one) => one.nodes[0]))];
    const half = 7.5 * small;
    const box = ([e, n]) => `M${x(e) - half} ${y(n) - half}h${2 * half}v${2 * half}h${-2 * half}z`;
    show("replans", "path", "replan", { d: remade.map((_, k) => box(node(remade)(k))).join("") });
    const moved = `translate(${x(here.east).toFixed(2)} ${y(here.north).toFixed(2)})`;
    const transform = `${moved} rotate(${here.course.toFixed(1)}) scale(${small})`;
    show("vehicle", "path", "vehicle", { d: "M0 -10L6.5 8L0 4.5L-6.5 8Z", ...told(here), transform });
    return made;
  }

  const reasons = new Map(
    run.tasks.filter((task) => !task.done).map((task) => [task.name.replace(/^waypoint /, ""), task.why]),
  );
  /** Marks of the waypoints: tasks done, visited, left, start and destination. */
  function places(colours, { unit, hidden, place: where }) {
    const shrunk = narrow() ? 0.72 : 1;
    const mark = (symbol, size, color, line) => ({ symbol, size: shrunk * size, color, line });
    const groups = [
      ["left", "left", mark("circle-open", 7, colours.left, { width: 1.6 })],
      ["visited", "passed, without a task", mark("circle", 7, colours.card, { color: colours.text, width: 1.4 })],
      ["task", "task done", mark("circle", 8.5, colours.task, { color: colours.halo, width: 1 })],
    ];
    const about = (node, words) => {
      const { name, place } = waypoints[node];
      const why = words === "left" && reasons.get(name.replace(/\[\d+\]$/, ""));
      const lines = [`<b>${report.literal(name)}</b>`, words, why && report.literal(why)];
      return report.joined("<br>", ...lines, `depth ${report.fixed(place[2])} m`, where(place[0], place[1]));
    };
    const visible = !hidden.has("waypoints");
    const one = (nodes, name, marker) => {
      const [x, y] = [1, 0].map((axis) => nodes.map((node) => waypoints[node].place[axis] / unit));
      const text = nodes.map((node) => about(node, name));
      return report.points(x, y, { meta: "waypoints", name, marker, visible, hoverinfo: "text", text });
    };
    const ends = [run.start, run.goal];
    const inner = [...waypoints.keys()].filter((node) => !ends.includes(node));
    return [
      ...groups.map(([state, words, marker]) => {
        return one(inner.filter((node) => waypoints[node].state === state), words, marker);
      }),
      one([run.start], "start", mark("circle", 12, colours.start, { color: "#000000", width: 1.2 })),
      one([run.goal], "destination", mark("star", 16, colours.task, { color: "#000000", width: 1 })),
    ];
  }

  const stage = element("div", { id: "map" });
  const now = element("dl.now", { id: "now" });
  const marks = [
    ["●", run.simulated ? "task done" : "task", "task"],
    ["○", "passed", "text"],
    ["○", "left", "left"],
  ].filter((_, k) => waypoints.some(({ state: mark }) => mark === ["task", "visited", "left"][k]));
  const signs = (entries) =>
    entries.map(([sign, words, colour], k) => [
      k ? ", " : "",
      element("span", { style: `color: var(--${colour}); font-weight: 600` }, `${sign} `),
      words,
    ]);
  const box = ([layer, words, shape, colour]) => {
    const onchange = (event) => state.map.toggle(layer, event.target.checked);
    const input = element("input", { type: "checkbox", checked: true, "data-layer": layer, onchange });
    return element("label", input, swatch(shape, colour), words);
  };
  const kinds = present.map(([name, colour]) => ["●", name, colour]);
  const boxes = element(
    "fieldset.layers",
    element("legend", "Layers"),
    layers.map(box),
    element("div.small.quiet", { style: "margin-top: .4rem" }, "Waypoints: ", signs(marks)),
    kinds.length > 1 ? element("div.small.quiet", "Obstacles: ", signs(kinds)) : null,
  );
  const note = element("p.quiet.small", { id: "map-note" });
  const beside = element("div.beside", element("div", element("h3", { id: "doing" }), now), boxes);
  const grid = element("div.mapgrid", element("div", stage, note), beside);
  const where = report.section("where", "Map", null, grid);

  const ranks = { task: 1, visited: 2, left: 3 };
  const labels = waypoints.map(({ name, place, state: mark }, node) => ({
    text: name,
    north: place[0],
    east: place[1],
    rank: node === run.start || node === run.goal ? 0 : ranks[mark],
    colour: mark === "left" ? "quiet" : "text",
  }));

  // --- transport: the time that all figures show ---------------------------------------------------------

  const length = Math.max(run.end - run.begin, 1);
  const nice = report.ticks(0, length, 700).step;
  const range = { type: "range", min: 0, max: Math.ceil(length), step: nice >= 1 ? 1 : "any", value: 0 };
  const moves = { "aria-label": "Time since departure", oninput: () => show(run.begin + Number(slider.value)) };
  const slider = element("input", { id: "time", ...range, ...moves });
  const space = { title: "Space", "aria-keyshortcuts": "Space", "aria-pressed": "false" };
  const pressed = { type: "button", id: "play", ...space, onclick: () => play(!state.playing) };
  const button = element("button.play", pressed, "▶ Play");
  const clock = element("output", { for: "time", id: "clock" });
  const speeds = { 60: "60 ×", 180: "180 ×", 600: "600 ×", 1800: "1800 ×" };
  const usual = Object.keys(speeds).reduce((best, speed) =>
    Math.abs(length / speed - 45) < Math.abs(length / best - 45) ? speed : best,
  );
  const speed = report.select({ id: "speed", "aria-label": "Speed of play" }, Object.entries(speeds), usual);
  const group = { role: "group", "aria-label": "Time" };
  const transport = element("div.transport", group, button, slider, clock, speed);
  where.before(transport);

  /** Scroll until the whole map is seen, right below the bar. */
  function reveal() {
    const bar = transport.getBoundingClientRect();
    const { top, bottom } = stage.getBoundingClientRect();
    if (top < bar.bottom || bottom > window.innerHeight) window.scrollBy(0, top - bar.height - 4);
  }
  const jump = Math.max(1, nice);
  slider.addEventListener("keydown", (event) => {
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 };
    if (!(event.key in steps)) return;
    event.preventDefault();
    show(state.time + steps[event.key] * jump);
  });
  document.addEventListener("keydown", (event) => {
    const busy = "button, select, summary, a, input:not([type='range']):not([type='radio'])";
    const held = event.ctrlKey || event.metaKey || event.altKey;
    if (event.key !== " " || held || event.target.closest(busy)) return;
    event.preventDefault();
    play(!state.playing);
  });

  function play(on) {
    if (on && state.time >= run.end - 1e-6) show(run.begin);
    state.playing = on;
    button.textContent = on ? "❚❚ Pause" : "▶ Play";
    button.setAttribute("aria-pressed", String(on));
    if (!on) return;
    reveal();
    let before = null;
    const advance = (moment) => {
      if (!state.playing) return;
      if (before !== null) show(state.time + ((moment - before) / 1000) * Number(speed.value));
      before = moment;
      if (state.time >= run.end - 1e-6) play(false);
      else requestAnimationFrame(advance);
    };
    requestAnimationFrame(advance);
  }

  /** Let all figures show a time. */
  function show(time) {
    state.time = Math.min(Math.max(time, run.begin), run.end);
    slider.value = String(Math.round(since(state.time)));
    slider.setAttribute("aria-valuetext", `${report.hours(since(state.time))}, ${doing(state.time)}`);
    clock.replaceChildren(
      `${report.clock(since(state.time))} `,
      element("small", report.utc(state.time, run.epoch) || `${report.fixed(since(state.time))} s`),
    );
    if (!state.due) requestAnimationFrame(move);
    state.due = true;
  }
  function move() {
    state.due = false;
    state.map.repaint();
    for (const follow of state.followers) follow();
    describe();
  }

  const BOUNDARIES =
    "Boundaries allow for three standard deviations of place and size and grow from one look to the next; " +
    "drawn about the true place.";
  function describe() {
    const here = vehicle(state.time);
    const level = current ? current.depths[Math.max(latest(current.times, state.time), 0)] : null;
    const place = state.map.place(here.north, here.east);
    const number = legAt(state.time);
    const moving = number >= 0 && state.time < run.legs[number].end;
    const apart = (name) => (report.isNumber(here[name]) ? `${distance(name, here[name])} m` : null);
    const entries = [
      ["depth", `${report.fixed(here.depth)} m`],
      ["speed over ground", moving ? `${report.fixed(here.speed, 2)} m/s` : "on station"],
      ["to the coast", apart("coast")],
      ["to a closed area", apart("closed")],
      ["to an obstacle", number >= 0 ? apart("obstacle") : null],
      ["above the sea bed", apart("bed")],
      ["position", place || `${report.fixed(here.north)} N, ${report.fixed(here.east)} E m`],
    ];
    document.getElementById("doing").textContent = doing(state.time);
    const known = entries.filter(([, value]) => value !== null);
    now.replaceChildren(...known.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
    const longest = current && `the longest are ${report.fixed(current.fastest, 2)} m/s.`;
    const notes = [
      current && `Arrows: current at ${report.fixed(level)} m, the vehicle's depth; ${longest}`,
      run.sensing && present.length && BOUNDARIES,
      run.known.length && "Known obstacles are drawn as they are, whatever the vehicle's depth.",
    ];
    note.replaceChildren(report.joined(" ", ...notes));
  }

  // --- side view -----------------------------------------------------------------------------------------

  const way = new Float64Array(track.time.length);
  for (let k = 1; k < way.length; k++) {
    const steps = ["north", "east", "depth"].map((name) => track[name][k] - track[name][k - 1]);
    way[k] = way[k - 1] + Math.hypot(...steps);
  }
  const wayAt = (time) => (way.length ? between(way, step(track.time, time)) : 0);
  const along = (time) => (state.axis === "time" ? since(time) / 3600 : wayAt(time) / 1000);
  state.followers = [];

  const CLEARANCES = [
    ["coast", "to the coast", "left"],
    ["closed", "to a closed area", "closed"],
    ["obstacle", "to the nearest obstacle", "earlier"],
    ["bed", "above the sea bed", "task"],
  ];
  if (track.time.length) {
    const side = element("div", { id: "side" });
    const near = CLEARANCES.filter(([name]) => track[name]);
    const axes = { time: "over time", distance: "over distance" };
    const choice = report.segments("axis", "Horizontal axis", axes, "time", (value) => {
      state.axis = value;
      profile.draw();
    });
    const shown = [
      ["depth of the vehicle", "line", "plan"],
      section && [`current with the vehicle, up to ${report.fixed(section.fastest, 1)} m/s`, "area", "task"],
      section && ["against it", "area", "route"],
      section && section.earlier.length && ["earlier plans", "dash", "earlier"],
      section && section.outlines.length && ["obstacles and boundaries above or below", "halo", "quiet"],
      track.bed && ["sea bed", "area", "bed"],
      ...near.map(([, words, colour]) => [words, "line", colour]),
    ].filter(Boolean);
    const inline = { style: "display: inline-flex; gap: .35rem; align-items: center" };
    const signs = shown.map(([words, shape, colour]) => element("span", inline, swatch(shape, colour), words));
    const made = report.section("profile", "Side view", null, element("div.choices.small.quiet", signs), side);
    made.querySelector(".head").append(choice);
    /** The vertical section: the current, obstacles over it, earlier plans over these. */
    const water = (colours) => {
      const columns = section.times.length - 1;
      const known = (value) => (value < -30 ? null : value);
      const row = (k) => Array.from(section.along.subarray(k * columns, (k + 1) * columns), known);
      const strong = (name) => report.mix(colours[name], 0.75, colours.card);
      const drawn = [
        {
          type: "heatmap",
          x: Array.from(section.times, along),
          y: section.depth,
          z: section.depth.slice(1).map((_, k) => row(k)),
          zmin: -section.fastest,
          zmax: section.fastest,
          colorscale: [[0, strong("route")], [0.5, colours.card], [1, strong("task")]],
          showscale: false,
          hovertemplate: "current along the path %{z:.2f} m/s at %{y:.0f} m<extra></extra>",
        },
      ];
      for (const { kind, grown, times, depths } of section.outlines) {
        const color = colours[COLOUR[kind] || "quiet"];
        const line = { color, width: 1.2, dash: grown ? "dash" : "solid" };
        const filled = { fill: "toself", fillcolor: report.mix(color, grown ? 0 : 0.8) };
        drawn.push(report.line(times.map(along), depths, line, filled));
      }
      for (const { times, depths } of section.earlier)
        drawn.push(report.line(times.map(along), depths, { color: colours.earlier, width: 1.4, dash: "dash" }));
      return drawn;
    };
    const draw = (colours, width) => {
      const axis = Array.from(track.time, along);
      const when = Array.from(track.time, (time) => report.clock(since(time)));
      const bed = track.bed && Array.from(track.bed, (above, k) => track.depth[k] + above);
      const floor = section ? section.depth.at(-1) : Math.max(...(bed || track.depth)) * 1.06 + 1;
      const data = section ? water(colours) : [];
      /** A line over the way that the pointer asks the moment of. */
      const trace = (y, color, width, name, words, more) => {
        const asked = { customdata: when, hovertemplate: `${words}<extra></extra>` };
        data.push({ x: axis, y, mode: "lines", name, line: { color, width }, ...asked, ...more });
      };
      if (bed) {
        trace(bed, colours.bed, 1.5, "sea bed", "sea bed %{y:,.0f} m");
        const ends = [axis[0], axis[axis.length - 1]];
        const filled = { fill: "tonexty", fillcolor: report.mix(colours.bed, 0.6, colours.card) };
        data.push(report.line(ends, [floor, floor], { width: 0 }, filled));
      }
      const depth = Array.from(track.depth);
      trace(depth, colours.plan, 2.2, "vehicle", "vehicle %{y:,.0f} m deep at %{customdata}");
      const safe = (values) => Array.from(values, (value) => Math.max(value, 0.5));
      for (const [name, words, colour] of near)
        trace(safe(track[name]), colours[colour], 1.6, words, `%{y:,.0f} m ${words}`, { yaxis: "y2" });
      const shapes = [];
      for (const { name, margin } of run.limits) {
        const drawn = near.find(([other]) => other === name);
        const line = drawn && { color: colours[drawn[2]], width: 1.2, dash: "dash" };
        if (drawn && margin > 0) shapes.push(report.rule("y2", margin, line));
      }
      const two = near.length > 0;
      const shown = near.flatMap(([name]) => safe(track[name]));
      const lower = { domain: [0, section ? 0.35 : 0.43], automargin: false };
      const upper = { domain: two ? [0.5 - (section ? 0.1 : 0), 1] : [0, 1], automargin: false };
      const title = state.axis === "time" ? "time since departure [h]" : "way [km]";
      return {
        data,
        height: (two ? 430 : 260) + (section ? 90 : 0),
        layout: {
          shapes,
          hovermode: "x",
          margin: { l: width < 500 ? 48 : 58, r: 14, t: 10, b: 46 },
          xaxis: report.axis(colours, title, { anchor: two ? "y2" : "y", range: [run.begin, run.end].map(along) }),
          yaxis: report.axis(colours, "depth [m]", { ...upper, range: [floor, Math.min(0, ...track.depth)] }),
          ...(two && { yaxis2: report.logAxis(colours, "clearance [m]", shown, lower) }),
        },
      };
    };
    const profile = report.drawn(side, "Side view: depth and clearances", draw, (host, first) => {
      if (!first) return;
      host.on("plotly_click", ({ points }) => show(track.time[points[0].pointIndex]));
      state.followers.push(report.cursor(host, () => along(state.time)));
    });
    const dashed = "Dashed: the margin that a plan keeps. Clearances on a logarithmic scale. A click shows that moment.";
    if (run.limits.some(({ name, margin }) => margin > 0 && near.some(([other]) => other === name)))
      made.append(report.remark(dashed));
  }

  // --- route --------------------------------------------------------------------------------------

  if (run.kind !== "leg" && run.routes.some((route) => route.bars.length)) {
    const timeline = element("div", { id: "timeline" });
    const each = "Each row is the route as it was planned at that moment, the lowest one what was done.";
    const wide = "Wide bars are travel, narrow ones time on station; darker is of higher priority.";
    const made = report.section("routes", "Route", run.simulated ? `${each} ${wide}` : wide, timeline);
    const rows = run.routes;
    const title = (route, k, brief) => {
      if (route.cause === "done") return run.simulated ? "<b>done</b>" : "<b>plan</b>";
      const cause = report.literal(route.cause);
      if (!k) return brief ? "first" : "first route";
      if (brief) return `R${k} ${cause}`;
      return `R${k} at ${report.fixed(since(route.made))} s, ${CAUSES[route.cause] || cause}`;
    };
    const draw = (colours, width) => {
      const narrow = width < 620;
      const most = Math.max(1, ...rows.flatMap((route) => route.bars.map((bar) => bar[5])));
      const shade = (priority) =>
        priority > 0 ? report.mix(colours.accent, 0.18 + (0.72 * priority) / most, colours.card) : colours.card;
      const bars = rows.flatMap((route, row) => route.bars.map((bar) => ({ row, bar })));
      const called = (node) => report.literal(waypoints[node].name);
      const one = (wide, from, size) => ({
        type: "bar",
        orientation: "h",
        width: wide,
        y: bars.map(({ row }) => row),
        base: bars.map(({ bar }) => since(from(bar)) / 3600),
        x: bars.map(({ bar }) => size(bar) / 3600),
        marker: { color: bars.map(({ bar }) => shade(bar[5])), line: { color: colours.quiet, width: 0.7 } },
        customdata: bars.map(({ bar: [from, to, , travel, task, priority] }) => {
          return [called(from), called(to), priority, Math.round(travel), Math.round(task)];
        }),
        text: wide > 0.5 ? bars.map(({ bar }) => called(bar[1])) : null,
        textposition: "inside",
        insidetextanchor: "middle",
        textangle: 0,
        insidetextfont: { size: 10 },
        constraintext: "inside",
        hovertemplate:
          "%{customdata[0]} → %{customdata[1]}<br>priority %{customdata[2]:.3g}<br>" +
          "travel %{customdata[3]:,} s, on station %{customdata[4]:,} s<extra></extra>",
      });
      const ends = bars.map(({ bar }) => since(bar[2]) + bar[3] + bar[4]);
      const last = Math.max(run.available, since(run.end), ...ends) / 3600;
      const place = { x: run.available / 3600, y: 1, xref: "x", yref: "paper" };
      const words = { text: "time available", font: { size: 11, color: colours.bad }, showarrow: false };
      const ticks = { tickvals: rows.map((_, k) => k), ticktext: rows.map((route, k) => title(route, k, narrow)) };
      const bare = { showgrid: false, ticks: "", automargin: false, title: { text: "" } };
      return {
        data: [one(0.76, (bar) => bar[2], (bar) => bar[3]), one(0.3, (bar) => bar[2] + bar[3], (bar) => bar[4])],
        height: 74 + Math.max(24, Math.min(40, 300 / rows.length)) * rows.length + 14,
        layout: {
          barmode: "overlay",
          uniformtext: { mode: "hide", minsize: 10 },
          hovermode: "closest",
          margin: { l: narrow ? 66 : 170, r: 14, t: 24, b: 46 },
          xaxis: report.axis(colours, "time since departure [h]", { range: [0, 1.015 * last] }),
          yaxis: report.axis(colours, "", { range: [rows.length - 0.4, -0.6], ...ticks, ...bare }),
          annotations: [{ ...place, ...words, yanchor: "bottom", xanchor: "right" }],
          shapes: [report.rule("x", run.available / 3600, { color: colours.bad, width: 2 })],
        },
      };
    };
    report.drawn(timeline, "Routes over time", draw, (host, first) => {
      if (first) state.followers.push(report.cursor(host, () => since(state.time) / 3600));
    });
    const late = rows.map((route, k) => ({ route, k })).filter(({ route }) => route.why);
    const why = ({ route, k }) => element("li", `${title(route, k)}: ${route.why}`);
    if (late.length)
      made.append(report.details("Why the route was re-planned", element("ul.small", late.map(why))));
  }

  // --- tables ----------------------------------------------------------------------------------------------

  const cause = (name) => CAUSES[name] || name;
  const causes = (leg) => Object.entries(leg.replans).map(([name, count]) => `${count} ${cause(name)}`).join(", ");
  const inside = (value) => (report.isNumber(value) && value < 0 ? "bad-cell" : "");
  const clearance = (name, title, key = (leg) => leg[name]) =>
    run.legs.some((leg) => report.isNumber(key(leg))) && {
      title,
      key,
      text: (leg) => distance(name, key(leg)),
      class: (leg) => inside(key(leg)),
    };
  const showLeg = (leg, k) =>
    report.link(`Show leg ${k + 1}`, String(k + 1), () => {
      show(leg.begin);
      reveal();
    });
  const behind = ({ executed, expected }) => `${executed >= expected ? "+" : ""}${report.fixed(executed - expected)}`;
  if (run.legs.length) {
    const levels = ({ depths }) => [...new Set([0, 2].map((k) => report.fixed(depths[k])))].join("–");
    const replans = (leg) => Object.values(leg.replans).reduce((a, b) => a + b, 0);
    const number = (leg, k) => (leg.begin === null ? String(k + 1) : showLeg(leg, k));
    const late = (leg) => (report.isNumber(leg.executed) ? behind(leg) : "–");
    const columns = [
      { title: "leg", key: (leg) => run.legs.indexOf(leg), text: number },
      report.words("from → to", legName, { key: (leg) => nodeName(leg.from) }),
      run.kind !== "leg" && report.weight("priority", (leg) => leg.priority, "–"),
      report.number("expected", "expected"),
      report.number("planned", "planned"),
      run.simulated && report.number("executed", "executed"),
      run.simulated && { title: "executed − expected", key: (leg) => leg.executed - leg.expected, text: late },
      report.number("task", "task"),
      report.number("way", "length"),
      run.legs.some((leg) => report.isNumber(leg.speed)) && report.number("speed, m/s", "speed", 2),
      { title: "depth", key: (leg) => leg.depths?.[1], text: (leg) => (leg.depths ? levels(leg) : "–") },
      clearance("coast", "coast"),
      clearance("closed", "closed area"),
      clearance("obstacle", "obstacle"),
      clearance("bed", "bed"),
      run.simulated && report.words("re-plans", (leg) => causes(leg) || "none", { key: replans }),
      report.yesNo("reached", (leg) => leg.arrived, true, (leg) => (leg.begin === null ? "refused" : "no")),
    ];
    const units = "Times in seconds, distances in metres: the least on the leg. ";
    const why = run.simulated ? "Re-plans by their cause: a window of the leg, or a hazard ahead." : "";
    const legs = report.table(report.counted(run.legs.length, "leg"), columns, run.legs, "legs-table");
    report.section("legs", "Legs", units + why, legs);
  }

  if (run.tasks.length) {
    const [done, left] = [true, false].map((wanted) => run.tasks.filter((task) => task.done === wanted));
    const priority = report.weight("priority", (task) => task.priority);
    const called = (more) => report.words("task", (task) => task.name, { key: (task) => task.name, ...more });
    const after = { title: "after", key: (task) => task.at, text: (task) => report.clock(since(task.at)) };
    const stay = [called({ class: "long" }), priority, after, report.number("on station, s", "duration")];
    const kept = [called(), priority, report.words("why", (task) => task.why, { class: "long" })];
    const title = `${run.simulated ? "Done" : "Planned"}: ${report.counted(figures.tasks, "task")}`;
    const tables = [report.table(title, stay, done, "done-table")];
    if (left.length) tables.push(report.table(`Left: ${report.fixed(left.length)}`, kept, left, "left-table"));
    report.section("tasks", "Tasks", null, report.pair(...tables));
  }

  const { cpu, forecast } = figures;
  const words = { coast: "coast", closed: "closed area", obstacle: "obstacle", bed: "sea bed" };
  const broken = plans.filter((plan) => !plan.feasible).length;
  const planned = cpu.path_s + cpu.mission_s > 0;
  const took = (value, more = "") => `${report.fixed(value, 2)} s${more}`;
  const both = forecast && `${report.fixed(forecast.planned_s)} s, ${report.fixed(forecast.executed_s)} s`;
  const costs = [
    ["cost of the mission (Eq. 15)", report.fixed(figures.cost_mission, 1)],
    ["with re-planning time (Eq. 16)", report.fixed(figures.cost_total, 1)],
    planned && ["planning of paths", took(cpu.path_s, `, ${report.counted(figures.path_calls, "leg")}`)],
    planned && ["planning of routes", took(cpu.mission_s, `, of which re-plans ${took(cpu.mission_replans_s)}`)],
    planned && ["estimates of travel times", took(cpu.travel_times_s)],
    cpu.charged_s && ["charged to the mission's clock", took(cpu.charged_s)],
    forecast && ["travel time, planned and simulated", both],
    forecast && ["forecast error of the current", `${report.fixed(forecast.current_difference, 2)} m/s (rms)`],
  ].filter(Boolean);
  const nearest = ({ name, least }) => (report.isNumber(least) ? distance(name, least) : "none near");
  const limits = [
    report.words("to", (row) => words[row.name]),
    { title: "margin of plans", text: (row) => report.fixed(row.margin) },
    { title: "least", text: nearest, class: (row) => inside(row.least) },
  ];
  const collided = `${report.counted(figures.collisions, "collision")} on the track`;
  const kept = broken
    ? `${report.counted(broken, "path plan")} of ${plans.length} kept not every limit`
    : "every path plan kept all limits";
  const seen = "as the planner saw it. Margins are the planner's; the true sea may take some of them.";
  const least = [
    report.table("Least distances on the whole way, m", limits, run.limits),
    report.remark(`${collided}; ${kept}, ${seen}`),
  ];
  const each = [
    { title: "leg", key: (plan) => plan.leg, text: (plan) => String(plan.leg + 1) },
    { title: "made after", key: (plan) => plan.made, text: (plan) => report.clock(since(plan.made)) },
    report.words("cause", (plan) => cause(plan.cause), { key: (plan) => plan.cause }),
    report.number("travel time, s", "time"),
    report.number("cost (Eq. 12), s", "cost", 1),
    report.weight("violation", (plan) => plan.violation),
    report.yesNo("limits kept", (plan) => plan.feasible, true),
    cpu.path_s > 0 && report.number("planning, s", "cpu", 3),
  ];
  const every = report.table("Path plans in the order of the legs", each, plans, "plans-table");
  const pair = report.pair(report.facts("Costs and planning", costs), least);
  const more = plans.length ? report.details(`Every path plan (${plans.length})`, every) : null;
  report.section("costs", "Costs and limits", null, pair, more);

  report.provenance(run.provenance);

  state.map = report.map(stage, "Map of the mission", run.map, places, labels, (x, y) =>
    state.map ? painted(x, y) : [],
  );
  state.map.repaint();
  where.querySelector(".head").append(state.map.buttons());
  show(run.begin);
})();
