const report = { data: JSON.parse(document.getElementById("data").textContent) };

// --- numbers and words -------------------------------------------------------------------------------

/** The numbers of a packed array, in the order of its bytes. */
report.unpack = function (array) {
  if (!array) return null;
  const bytes = Uint8Array.from(atob(array.data), (sign) => sign.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  const read = {
    f32: (k) => view.getFloat32(4 * k, true),
    i16: (k) => view.getInt16(2 * k, true),
    i32: (k) => view.getInt32(4 * k, true),
  }[array.kind];
  const size = array.shape.reduce((product, edge) => product * edge, 1);
  const values = new Float64Array(size);
  for (let k = 0; k < size; k++) values[k] = array.step === 1 ? read(k) : read(k) * array.step;
  return values;
};

/** An object with its arrays of these names unpacked, null where it has none; nothing of nothing. */
report.unpacked = (one, ...names) =>
  one && { ...one, ...Object.fromEntries(names.map((name) => [name, report.unpack(one[name])])) };

report.isNumber = (value) => typeof value === "number" && Number.isFinite(value);

/** A number to some decimals; a dash where there is none. */
report.fixed = function (value, decimals = 0) {
  if (!report.isNumber(value)) return "–";
  const form = { minimumFractionDigits: decimals, maximumFractionDigits: decimals };
  return value.toLocaleString("en", form).replace("-", "−");
};

/** A number to some significant digits. */
report.figure = function (value, digits = 4) {
  if (!report.isNumber(value)) return "–";
  const large = Math.abs(value) >= 10 ** (digits - 1);
  const form = large ? { maximumFractionDigits: 0 } : { maximumSignificantDigits: digits };
  return value.toLocaleString("en", form).replace("-", "−");
};

/** A least distance in metres, as `auvplan.runtime.formatting.clearance` states it. */
report.clearance = function (value, accuracy = 0, reach = null) {
  if (!report.isNumber(value)) return "–";
  if (reach !== null && value >= reach) return `> ${report.fixed(reach)}`;
  if (value >= 0 && value < accuracy) return `< ${report.fixed(accuracy)}`;
  return report.fixed(accuracy > 0 ? accuracy * Math.floor(value / accuracy) : value);
};

const two = (value) => String(Math.floor(value)).padStart(2, "0");

/** Seconds as hours and minutes. */
report.hours = function (seconds) {
  if (!report.isNumber(seconds)) return "–";
  const minutes = Math.round(Math.abs(seconds) / 60);
  return `${seconds < 0 && minutes ? "−" : ""}${Math.floor(minutes / 60)} h ${two(minutes % 60)} min`;
};

/** Seconds as h:mm:ss. */
report.clock = function (seconds) {
  const whole = Math.round(Math.abs(seconds));
  return `${seconds < 0 ? "−" : ""}${Math.floor(whole / 3600)}:${two((whole / 60) % 60)}:${two(whole % 60)}`;
};

/** The moment of a time in UTC, to the nearest second; empty where the result has no date. */
report.utc = function (seconds, epoch) {
  if (!epoch) return "";
  const moment = new Date(1000 * Math.round(new Date(epoch).getTime() / 1000 + seconds));
  return `${moment.toISOString().slice(0, 19).replace("T", " ")} UTC`;
};

report.counted = (count, noun) => `${report.fixed(count)} ${noun}${count === 1 ? "" : "s"}`;

/** Text for Plotly, which would take some of it for markup. */
report.literal = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

// --- elements ----------------------------------------------------------------------------------------

/** An element, "tag.class", with attributes and listeners ("onclick") if any, and children; texts are never markup. */
function element(what, ...children) {
  const [tag, ...classes] = what.split(".");
  const svg = ["svg", "g", "path", "circle", "rect", "line", "text"].includes(tag);
  const space = svg ? "http://www.w3.org/2000/svg" : "http://www.w3.org/1999/xhtml";
  const made = document.createElementNS(space, tag);
  if (classes.length) made.setAttribute("class", classes.join(" "));
  const attributes = children[0]?.constructor === Object ? children.shift() : {};
  for (const [name, value] of Object.entries(attributes)) {
    if ((value ?? false) === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat(9).filter((child) => child !== null && child !== undefined));
  return made;
}

/** A titled part of the page, listed in its contents. */
report.section = function (id, title, note, ...children) {
  const head = element("div.head", element("h2", { id: `${id}-title` }, title));
  const words = note ? element("p.quiet", note) : null;
  const made = element("section.card", { id, "aria-labelledby": `${id}-title` }, head, words, ...children);
  document.getElementById("main").append(made);
  const contents = document.querySelector("nav.contents");
  if (contents) contents.append(element("a", { href: `#${id}` }, title));
  return made;
};

/** A choice between a few values, the first of which holds at first. */
report.segments = function (name, title, values, chosen, change) {
  const choices = Object.entries(values).map(([value, words]) => {
    const attributes = { type: "radio", name, value, checked: value === chosen };
    const input = element("input", { ...attributes, onchange: () => change(value) });
    return element("label", input, element("span", words));
  });
  return element("fieldset.segments", element("legend.hidden", title), choices);
};

/** Large figures of the page's head: [name, value, note]. */
report.tiles = function (entries) {
  const made = (entries || []).filter(Boolean).map(([name, value, note]) => {
    const small = note ? element("small", note) : null;
    return element("div.tile", element("dt", name), element("dd", value, small));
  });
  return element("dl.tiles", made);
};

/**
 * A table that its headings sort.
 *
 * A column has `title`, `text(row)`; and `key(row)`, by which it is sorted, `words` where it holds text, `class`.
 */
report.table = function (caption, columns, rows, id = null) {
  const body = element("tbody");
  columns = columns.filter(Boolean);
  const shown = rows.map((row, number) => {
    const cells = columns.map((column, place) => {
      const own = typeof column.class === "function" ? column.class(row) : column.class;
      const name = report.joined(" ", column.words && "words", own) || null;
      const attributes = { class: name, scope: place === 0 ? "row" : null };
      return element(place === 0 ? "th" : "td", attributes, column.text(row, number));
    });
    return element("tr", { "data-row": number }, cells);
  });
  body.append(...shown);
  const headings = columns.map((column) => {
    const sorts = column.key && rows.length > 1;
    const attributes = { type: "button", onclick: () => sort(column, heading) };
    // Buttons are left out of a heading that is repeated on the next sheet of paper.
    const parts = [element("button", attributes, column.title), element("span.printed", column.title)];
    const given = { scope: "col", class: column.words ? "words" : null };
    const heading = element("th", given, sorts ? parts : column.title);
    return heading;
  });
  function sort(column, heading) {
    const falls = heading.getAttribute("aria-sort") === "ascending";
    for (const other of headings) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", falls ? "descending" : "ascending");
    const rank = (row) => {
      const value = column.key(rows[Number(row.dataset.row)]) ?? null;
      return Number.isNaN(value) ? null : value;
    };
    const sorted = [...shown].sort((one, other) => {
      const [a, b] = [one, other].map(rank);
      if (a === null || b === null) return (a === null) - (b === null);
      const order = typeof a === "string" ? a.localeCompare(b, "en", { numeric: true }) : a - b;
      return falls ? -order : order;
    });
    body.append(...sorted);
  }
  const made = [element("caption", caption), element("thead", element("tr", headings)), body];
  const region = { tabindex: "0", role: "region", "aria-label": caption };
  return element("div.scroll", region, element("table", { id }, made));
};

/** Mark the row of a number in a table. */
report.mark = function (table, number) {
  for (const row of table.querySelectorAll("tbody tr"))
    row.classList.toggle("chosen", Number(row.dataset.row) === number);
};

/** A column of numbers: of a field or a function of a row, to some decimals. */
report.number = function (title, of, decimals = 0, more = {}) {
  const key = typeof of === "function" ? of : (row) => row[of];
  return { title, key, text: (row) => report.fixed(key(row), decimals), ...more };
};

/** A column of numbers with three significant digits. */
report.weight = function (title, key, none) {
  return { title, key, text: (row) => (none && !key(row) ? none : report.figure(key(row), 3)) };
};

/** A column of words, sorted by them or by another key. */
report.words = (title, text, more = {}) => ({ title, words: true, text, ...more });

/** A column of yes and no; what is not so stands out where that is bad. */
report.yesNo = (title, of, bad = false, no = () => "no") => ({
  title,
  words: true,
  key: (row) => Number(of(row)),
  text: (row) => (of(row) ? "yes" : no(row)),
  class: (row) => (bad && !of(row) ? "bad-cell" : ""),
});

/** Parts beside each other where there is room. */
report.pair = (...parts) =>
  element("div.pair", parts.filter(Boolean).map((part) => element("div", part)));

/** Words with something between them; those that are not there are left out. */
report.joined = (between, ...parts) => parts.filter(Boolean).join(between);

/** What is shown on demand. */
report.details = (summary, ...children) =>
  element("details", element("summary", summary), ...children);

/** A button that looks like a link. */
report.link = (label, words, onclick, more = {}) =>
  element("button.link", { type: "button", "aria-label": label, onclick, ...more }, words);

/** A remark in small letters. */
report.remark = (...children) => element("p.small.quiet", ...children);

/** A choice from a list of [value, words]. */
report.select = function (attributes, entries, chosen) {
  const option = ([value, words]) => element("option", { value, selected: value === chosen }, words);
  return element("select", attributes, entries.map(option));
};

/** A table of names and values. */
report.facts = function (caption, entries) {
  const rows = entries.map(([name, value]) =>
    element("tr", element("th", { scope: "row", class: "words" }, name), element("td.words", value)),
  );
  return element("div.scroll", element("table", element("caption", caption), element("tbody", rows)));
};

// --- light and dark ----------------------------------------------------------------------------------

/** The page's colours, light and dark, by the names that its style sheet gives them. */
const COLOURS = {
  page: ["#f6f8fa", "#0e141a"],
  card: ["#ffffff", "#161e26"],
  line: ["#d8dee5", "#2c3843"],
  soft: ["#eef2f5", "#1d2731"],
  text: ["#17212b", "#e5ebf0"],
  quiet: ["#566573", "#9dabb8"],
  accent: ["#0072b2", "#56b4e9"],
  "accent-text": ["#ffffff", "#07131c"],
  good: ["#00704f", "#45c79d"],
  bad: ["#b04a00", "#f0954a"],
  "warn-back": ["#fff4d6", "#35290f"],
  "warn-line": ["#d98c00", "#e69f00"],
  water: ["#eef5fb", "#101b26"],
  grid: ["#dde5ec", "#24313d"],
  coast: ["#c9b98f", "#5a5038"],
  track: ["#111820", "#f2f5f7"],
  plan: ["#0072b2", "#56b4e9"],
  earlier: ["#d55e00", "#f08a3c"],
  closed: ["#a8320f", "#ff9d7a"],
  route: ["#6a4c93", "#c3a6ea"],
  current: ["#4f7a9a", "#5f8fb3"],
  static: ["#b3567f", "#e08fb4"],
  afloat: ["#d08a00", "#f0b43c"],
  moving: ["#2f8fc4", "#7cc8f2"],
  known: ["#c24f00", "#f0803c"],
  sense: ["#3f6f57", "#7fc2a0"],
  task: ["#009e73", "#2cc796"],
  left: ["#8a96a3", "#8592a0"],
  start: ["#f0e442", "#f0e442"],
  depth: ["#7fa3bd", "#45708f"],
  bed: ["#d9c9a0", "#4d4530"],
  halo: ["#ffffff", "#101b26"],
};

report.themed = [];
report.prefersDark = window.matchMedia("(prefers-color-scheme: dark)");
report.printing = false;

report.kept = function () {
  try {
    return localStorage.getItem("auvplan-theme") || "auto";
  } catch {
    return "auto";
  }
};

report.theme = () => document.documentElement.dataset.theme;

/** The colours of the theme that is shown, by name. */
report.colours = function () {
  const place = report.theme() === "dark" ? 1 : 0;
  return Object.fromEntries(Object.entries(COLOURS).map(([name, pair]) => [name, pair[place]]));
};

/** A colour, given as #rrggbb, that covers what is under it by a share; over another colour, where one is given. */
report.mix = function (colour, share, under) {
  const parts = (text) => [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16));
  const over = parts(colour);
  if (!under) return `rgba(${over.join(", ")}, ${share})`;
  const below = parts(under);
  return `rgb(${over.map((value, k) => Math.round(share * value + (1 - share) * below[k])).join(", ")})`;
};

report.applyTheme = function () {
  const dark = report.chosenTheme === "dark" || (report.chosenTheme === "auto" && report.prefersDark.matches);
  const root = document.documentElement;
  root.dataset.theme = dark && !report.printing ? "dark" : "light";
  for (const [name, colour] of Object.entries(report.colours())) root.style.setProperty(`--${name}`, colour);
  for (const follow of report.themed) follow();
};

report.chosenTheme = report.kept();
report.applyTheme();
report.prefersDark.addEventListener("change", () => report.applyTheme());

report.chooseTheme = function (value) {
  report.chosenTheme = value;
  try {
    localStorage.setItem("auvplan-theme", value);
  } catch {
    // A page from a file may keep nothing: the choice holds for as long as it is open.
  }
  report.applyTheme();
};

// --- head, provenance, foot --------------------------------------------------------------------------

/** Text whose parts between backticks are commands. */
report.marked = (text) =>
  text.split("`").map((part, k) => (k % 2 ? element("code.code", part) : part));

report.head = function ({ title, line, badge, good, tiles, warnings = [] }) {
  const outcome = [element(`span.badge.${good ? "good" : "bad"}`, badge), " ", element("span.quiet", line)];
  const themes = { auto: "Auto", light: "Light", dark: "Dark" };
  const choice = report.segments("theme", "Colours", themes, report.chosenTheme, report.chooseTheme);
  document.getElementById("top").append(
    element("div.headline", element("div", element("h1", title), element("p", outcome)), choice),
    element("nav.contents", { "aria-label": "Contents" }),
    report.tiles(tiles),
    ...warnings.map((words) => element("p.warning", report.marked(words))),
  );
};

report.setting = (value) => (value === null || value === undefined ? "none" : JSON.stringify(value));

/** The part that says what a result was made from. */
report.provenance = function ({ files = [], assumed = [], notes = [], seeds, seed, versions = {}, settings }) {
  const code = { class: "code" };
  const named = [
    report.words("field", (file) => file.field),
    report.words("file", (file) => file.name, code),
    { title: "bytes", text: (file) => report.fixed(file.size) },
    report.words("SHA-256", (file) => file.sha256 || "–", code),
  ];
  const none = "The scenario names no files: chart, currents and tasks come from the package and the seed.";
  const shown = seeds || seed;
  const origin = [
    ...(report.isNumber(shown) || shown ? [["seed", String(shown)]] : []),
    ...Object.entries(versions).map(([name, value]) => [`version of ${name}`, value]),
  ];
  const changed = [
    report.words("setting", (row) => row.field, code),
    report.words("value", (row) => report.setting(row.value), code),
    report.words("default", (row) => report.setting(row.default), code),
  ];
  const differing = settings?.length
    ? report.table("Settings that differ from the defaults", changed, settings)
    : element("p", settings ? "All settings have their defaults." : "The folder does not state which scenario this was.");
  report.section(
    "provenance",
    "Provenance",
    null,
    files.length ? report.table("Files that the scenario names", named, files) : settings && element("p", none),
    assumed.map((line) => element("p", `Assumed: ${line}.`)),
    notes.map((line) => element("p", `Note: ${line}.`)),
    report.pair(origin.length && report.facts("Seed and versions", origin), differing),
  );
  const foot = "Written by auvplan. Figures: plotly.js, MIT licence. This file loads nothing from anywhere.";
  document.getElementById("foot").append(element("p", foot));
};
