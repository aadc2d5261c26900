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

/** A number with so many decimals; a dash where there is none. */
report.fixed = function (value, decimals = 0) {
  if (!report.isNumber(value)) return "–";
  const text = value.toLocaleString("en", {
    minimumFractionDigits: decimals,
    maximumFractionDigits: decimals,
  });
  return text.replace("-", "−");
};

/** A number with so many significant digits. */
report.figure = function (value, digits = 4) {
  if (!report.isNumber(value)) return "–";
  const large = Math.abs(value) >= 10 ** (digits - 1);
  const form = large ? { maximumFractionDigits: 0 } : { maximumSignificantDigits: digits };
  return value.toLocaleString("en", form).replace("-", "−");
};

/** A least distance in metres, as `auvplan.runtime.formatting.clearance` states it: no finer than what it is to is known. */
report.clearance = function (value, accuracy = 0, reach = null) {
  if (!report.isNumber(value)) return "–";
  if (reach !== null && value >= reach) return `> ${report.fixed(reach)}`;
  if (value >= 0 && value < accuracy) return `< ${report.fixed(accuracy)}`;
  return report.fixed(accuracy > 0 ? accuracy * Math.floor(value / accuracy) : value);
};

/** Seconds as hours and minutes. */
report.hours = function (seconds) {
  if (!report.isNumber(seconds)) return "–";
  const minutes = Math.round(Math.abs(seconds) / 60);
  const text = `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
  return seconds < 0 ? `−${text}` : text;
};

/** Seconds as h:mm:ss. */
report.clock = function (seconds) {
  const whole = Math.round(Math.abs(seconds));
  const two = (value) => String(value).padStart(2, "0");
  return `${seconds < 0 ? "−" : ""}${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
};

/** The moment of a time in UTC, to the second; empty where the result has no date. */
report.utc = function (seconds, epoch) {
  if (!epoch) return "";
  const moment = new Date(new Date(epoch).getTime() + 1000 * seconds);
  return `${moment.toISOString().slice(0, 19).replace("T", " ")} UTC`;
};

report.counted = (count, noun) => `${report.fixed(count)} ${noun}${count === 1 ? "" : "s"}`;

/** Text for Plotly, which would take some of it for markup. */
report.literal = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

// --- elements ----------------------------------------------------------------------------------------

/** An element with attributes, listeners ("onclick") and children; texts are never markup. */
report.element = function (tag, attributes = {}, ...children) {
  const svg = ["svg", "g", "path", "circle", "rect", "line", "text"].includes(tag);
  const made = svg
    ? document.createElementNS("http://www.w3.org/2000/svg", tag)
    : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? "" : value);
  }
  for (const child of children.flat(9)) {
    if (child !== null && child !== undefined) made.append(child);
  }
  return made;
};

/** A titled part of the page, listed in its contents. */
report.section = function (id, title, note, ...children) {
  const made = report.element(
    "section",
    { class: "card", id, "aria-labelledby": `${id}-title` },
    report.element("div", { class: "head" }, report.element("h2", { id: `${id}-title` }, title)),
    note ? report.element("p", { class: "quiet" }, note) : null,
    ...children,
  );
  document.getElementById("main").append(made);
  const contents = document.querySelector("nav.contents");
  if (contents) contents.append(report.element("a", { href: `#${id}` }, title));
  return made;
};

/** A choice between a few values, the first of which holds at first. */
report.segments = function (name, title, values, chosen, change) {
  return report.element(
    "fieldset",
    { class: "segments" },
    report.element("legend", { class: "hidden" }, title),
    Object.entries(values).map(([value, words]) =>
      report.element(
        "label",
        {},
        report.element("input", {
          type: "radio",
          name,
          value,
          checked: value === chosen,
          onchange: () => change(value),
        }),
        report.element("span", {}, words),
      ),
    ),
  );
};

report.tiles = (entries) =>
  report.element(
    "dl",
    { class: "tiles" },
    (entries || [])
      .filter(Boolean)
      .map(([name, value, note]) =>
        report.element(
          "div",
          { class: "tile" },
          report.element("dt", {}, name),
          report.element("dd", {}, value, note ? report.element("small", {}, note) : null),
        ),
      ),
  );

/**
 * A table that its headings sort.
 *
 * A column has `title`, `text(row)`; and `key(row)`, by which it is sorted, `words` where it holds text, `class`.
 */
report.table = function (caption, columns, rows, options = {}) {
  const body = report.element("tbody");
  const shown = rows.map((row, number) => {
    const cells = columns.map((column, place) => {
      const content = column.text(row, number);
      const name = [
        column.words ? "words" : "",
        typeof column.class === "function" ? column.class(row) : column.class || "",
      ];
      const attributes = { class: name.filter(Boolean).join(" ") || null };
      if (place === 0) attributes.scope = "row";
      return report.element(place === 0 ? "th" : "td", attributes, content);
    });
    return report.element("tr", { "data-row": number }, cells);
  });
  body.append(...shown);
  const headings = columns.map((column) => {
    const heading = report.element("th", { scope: "col", class: column.words ? "words" : null });
    if (!column.key || rows.length < 2) {
      heading.append(column.title);
      return heading;
    }
    // Buttons are left out of a heading that is repeated on the next sheet of paper.
    heading.append(
      report.element("button", { type: "button", onclick: () => sort(column, heading) }, column.title),
      report.element("span", { class: "printed" }, column.title),
    );
    return heading;
  });
  function sort(column, heading) {
    const falls = heading.getAttribute("aria-sort") === "ascending";
    for (const other of headings) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", falls ? "descending" : "ascending");
    const rank = (row) => {
      const value = column.key(rows[Number(row.dataset.row)]);
      return value === null || value === undefined || Number.isNaN(value) ? null : value;
    };
    const sorted = [...shown].sort((one, other) => {
      const [a, b] = [rank(one), rank(other)];
      if (a === null || b === null) return (a === null) - (b === null);
      const order = typeof a === "string" ? a.localeCompare(b, "en", { numeric: true }) : a - b;
      return falls ? -order : order;
    });
    body.append(...sorted);
  }
  const made = report.element(
    "table",
    { id: options.id },
    report.element("caption", {}, caption),
    report.element("thead", {}, report.element("tr", {}, headings)),
    body,
  );
  return report.element(
    "div",
    { class: "scroll", tabindex: "0", role: "region", "aria-label": caption },
    made,
  );
};

/** A column of numbers: of a field or a function of a row, to some decimals. */
report.number = function (title, of, decimals = 0, more = {}) {
  const key = typeof of === "function" ? of : (row) => row[of];
  return { title, key, text: (row) => report.fixed(key(row), decimals), ...more };
};

/** A column of numbers with three significant digits. */
report.weight = (title, key, none) => ({
  title,
  key,
  text: (row) => (none && !key(row) ? none : report.figure(key(row), 3)),
});

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
  report.element("div", { class: "pair" }, parts.filter(Boolean).map((part) => report.element("div", {}, part)));

/** Words with something between them; those that are not there are left out. */
report.joined = (between, ...parts) => parts.filter(Boolean).join(between);

/** What is shown on demand. */
report.details = (summary, ...children) =>
  report.element("details", {}, report.element("summary", {}, summary), ...children);

/** A remark in small letters. */
report.remark = (...children) => report.element("p", { class: "small quiet" }, ...children);

/** A choice from a list of [value, words]. */
report.select = (attributes, entries, chosen) =>
  report.element(
    "select",
    attributes,
    entries.map(([value, words]) => report.element("option", { value, selected: value === chosen }, words)),
  );

/** A table of names and values. */
report.facts = function (caption, entries) {
  const rows = entries.map(([name, value]) =>
    report.element(
      "tr",
      {},
      report.element("th", { scope: "row", class: "words" }, name),
      report.element("td", { class: "words" }, value),
    ),
  );
  return report.element(
    "div",
    { class: "scroll" },
    report.element("table", {}, report.element("caption", {}, caption), report.element("tbody", {}, rows)),
  );
};

// --- light and dark ----------------------------------------------------------------------------------

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

report.theme = function () {
  return document.documentElement.dataset.theme;
};

/** The page's colours by the names that its style sheet gives them. */
report.colours = function () {
  const style = getComputedStyle(document.documentElement);
  return new Proxy({}, { get: (_, name) => style.getPropertyValue(`--${String(name)}`).trim() });
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
  document.documentElement.dataset.theme = dark && !report.printing ? "dark" : "light";
  for (const follow of report.themed) follow();
};

report.chosenTheme = report.kept();
report.applyTheme();
report.prefersDark.addEventListener("change", () => report.applyTheme());

report.themeSwitch = () =>
  report.segments(
    "theme",
    "Colours",
    { auto: "Auto", light: "Light", dark: "Dark" },
    report.chosenTheme,
    (value) => {
      report.chosenTheme = value;
      try {
        localStorage.setItem("auvplan-theme", value);
      } catch {
        // A page from a file may keep nothing: the choice holds for as long as it is open.
      }
      report.applyTheme();
    },
  );

// --- head, provenance, foot --------------------------------------------------------------------------

/** Text whose parts between backticks are commands. */
report.marked = (text) =>
  text.split("`").map((part, k) => (k % 2 ? report.element("code", { class: "code" }, part) : part));

report.head = function ({ title, line, badge, good, tiles, warnings }) {
  document
    .getElementById("top")
    .append(
      report.element(
        "div",
        { class: "headline" },
        report.element(
          "div",
          {},
          report.element("h1", {}, title),
          report.element(
            "p",
            {},
            badge ? [report.element("span", { class: `badge ${good ? "good" : "bad"}` }, badge), " "] : null,
            report.element("span", { class: "quiet" }, line),
          ),
        ),
        report.themeSwitch(),
      ),
      report.element("nav", { class: "contents", "aria-label": "Contents" }),
      report.tiles(tiles),
      ...(warnings || []).map((words) => report.element("p", { class: "warning" }, report.marked(words))),
    );
};

report.setting = (value) => (value === null || value === undefined ? "none" : JSON.stringify(value));

/** The part that says what a result was made from. */
report.provenance = function (told) {
  const parts = [];
  const files = told.files || [];
  if (files.length) {
    parts.push(
      report.table(
        "Files that the scenario names",
        [
          report.words("field", (file) => file.field),
          report.words("file", (file) => file.name, { class: "code" }),
          { title: "bytes", text: (file) => report.fixed(file.size) },
          report.words("SHA-256", (file) => file.sha256 || "–", { class: "code" }),
        ],
        files,
      ),
    );
  } else if (told.settings) {
    parts.push(
      report.element(
        "p",
        {},
        "The scenario names no files: chart, currents and tasks come from the package and the seed.",
      ),
    );
  }
  for (const line of told.assumed || []) parts.push(report.element("p", {}, `Assumed: ${line}.`));
  for (const line of told.notes || []) parts.push(report.element("p", {}, `Note: ${line}.`));
  const seed = told.seeds || told.seed;
  const origin = [
    ...(report.isNumber(seed) || seed ? [["seed", String(seed)]] : []),
    ...Object.entries(told.versions || {}).map(([name, value]) => [`version of ${name}`, value]),
  ];
  const { settings } = told;
  const code = { class: "code" };
  const differ = () =>
    report.table(
      "Settings that differ from the defaults",
      [
        report.words("setting", (row) => row.field, code),
        report.words("value", (row) => report.setting(row.value), code),
        report.words("default", (row) => report.setting(row.default), code),
      ],
      settings,
    );
  parts.push(
    report.pair(
      origin.length && report.facts("Seed and versions", origin),
      !settings
        ? report.element("p", {}, "The folder does not state which scenario this was.")
        : settings.length
          ? differ()
          : report.element("p", {}, "All settings have their defaults."),
    ),
  );
  report.section("provenance", "Provenance", null, ...parts);
  document
    .getElementById("foot")
    .append(
      report.element(
        "p",
        {},
        "Written by auvplan. Figures: plotly.js, MIT licence. This file loads nothing from anywhere.",
      ),
    );
};
