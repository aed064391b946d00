"use strict";
// The page is complete without this; it adds sorting, filters, enlarged pictures and the choice of colours.

function compare(first, second, numeric, direction) {
  // What has no value stands last, whichever way the table is sorted.
  if (first === "" || second === "") return (first === "") - (second === "");
  // A column of options has numbers between texts: null, 0.5, 0.25. As a text, 0.5 would be less than 0.25.
  const difference = Number(first) - Number(second);
  const order = numeric || !Number.isNaN(difference) ? difference : first.localeCompare(second, undefined, { numeric: true });
  return direction * order;
}

for (const table of document.querySelectorAll("table.sortable")) {
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = heading.textContent;
    heading.replaceChildren(button);
    heading.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => {
      const numeric = heading.classList.contains("number");
      // Large numbers are what one looks for first, names begin with a.
      const first = numeric ? "descending" : "ascending";
      const other = numeric ? "ascending" : "descending";
      const order = heading.getAttribute("aria-sort") === first ? other : first;
      const direction = order === "ascending" ? 1 : -1;
      headings.forEach((each) => each.setAttribute("aria-sort", each === heading ? order : "none"));
      const body = table.tBodies[0];
      const rows = [...body.rows];
      const values = new Map(rows.map((row) => [row, row.cells[column].dataset.value]));
      rows.sort((a, b) => compare(values.get(a), values.get(b), numeric, direction));
      body.append(...rows);
    });
  });
}

const filters = document.getElementById("filters");
const cards = [...document.querySelectorAll(".card")];

function field(name) {
  const element = filters.elements[name];
  return element ? element.value : "";
}

function inGroup(card, group) {
  const seen = card.dataset.seen === "1";
  const unseen = card.dataset.unseen === "1";
  return { "": true, seen, unseen, "only-seen": seen && !unseen, "only-unseen": unseen && !seen }[group];
}

function scoreOf(card) {
  const value = card.getAttribute("data-" + field("measure").replaceAll("_", "-"));
  return value === null ? NaN : Number(value);
}

function withinScores(card) {
  const least = field("least");
  const most = field("most");
  const score = scoreOf(card);
  if (least === "" && most === "") return true;
  return score >= (least === "" ? -Infinity : Number(least)) && score <= (most === "" ? Infinity : Number(most));
}

function filter() {
  let shown = 0;
  for (const card of cards) {
    const keep =
      (field("run") === "" || card.dataset.run === field("run")) &&
      (field("dataset") === "" || card.dataset.dataset === field("dataset")) &&
      inGroup(card, field("group")) &&
      withinScores(card);
    card.hidden = !keep;
    shown += keep;
  }
  const order = field("order");
  const ordered = [...cards];
  if (order === "name") ordered.sort((a, b) => compare(a.dataset.name, b.dataset.name, false, 1));
  if (order === "worst" || order === "best") {
    const text = (card) => (Number.isNaN(scoreOf(card)) ? "" : String(scoreOf(card)));
    ordered.sort((a, b) => compare(text(a), text(b), true, order === "worst" ? 1 : -1));
  }
  document.getElementById("cards").append(...ordered);
  const panels = [...filters.querySelectorAll("[name=panel]")];
  const chosen = new Set(panels.filter((box) => box.checked).map((box) => box.value));
  for (const figure of document.querySelectorAll(".panels figure")) {
    figure.hidden = panels.some((box) => box.value === figure.dataset.panel) && !chosen.has(figure.dataset.panel);
  }
  for (const row of document.querySelectorAll(".panels:not(.whole)")) {
    const count = row.querySelectorAll("figure:not([hidden])").length;
    row.style.gridTemplateColumns = chosen.size === panels.length ? "" : `repeat(${Math.max(count, 1)}, minmax(0, 26rem))`;
  }
  document.getElementById("shown").textContent = `${shown} of ${cards.length} frames`;
  document.getElementById("none").hidden = shown > 0;
}

if (filters) {
  filters.hidden = false;
  filters.addEventListener("input", filter);
  filters.addEventListener("submit", (event) => event.preventDefault());
  filters.addEventListener("reset", () => setTimeout(filter));
  filter();
}

const viewer = document.getElementById("viewer");
const image = document.getElementById("viewer-image");
let current = null;
let opener = null;

function figuresOf(card) {
  return [...card.querySelectorAll("figure:not([hidden])")];
}

function view(figure) {
  current = figure;
  const card = figure.closest(".card");
  const picture = figure.querySelector("img");
  image.src = picture.src;
  image.alt = picture.alt;
  document.getElementById("viewer-title").textContent = `${card.dataset.name} · ${figure.querySelector("figcaption").textContent}`;
  const buttons = figuresOf(card).map((each) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = each.dataset.panel;
    button.setAttribute("aria-pressed", String(each === figure));
    button.addEventListener("click", () => view(each));
    return button;
  });
  const group = document.getElementById("viewer-panels");
  const hadFocus = group.contains(document.activeElement);
  group.replaceChildren(...buttons);
  if (hadFocus) group.querySelector("[aria-pressed=true]").focus();
}

function stepPanel(by) {
  const figures = figuresOf(current.closest(".card"));
  view(figures[(figures.indexOf(current) + by + figures.length) % figures.length]);
}

function stepFrame(by) {
  const shown = [...document.querySelectorAll(".card:not([hidden])")];
  const next = shown[(shown.indexOf(current.closest(".card")) + by + shown.length) % shown.length];
  const figures = figuresOf(next);
  view(figures.find((figure) => figure.dataset.panel === current.dataset.panel) || figures[0]);
}

for (const button of document.querySelectorAll(".panels button")) {
  button.addEventListener("click", () => {
    opener = button;
    view(button.closest("figure"));
    viewer.showModal();
  });
}
viewer.querySelector("[data-close]").addEventListener("click", () => viewer.close());
viewer.addEventListener("close", () => opener && opener.focus());
viewer.addEventListener("click", (event) => {
  if (event.target === viewer) viewer.close();
});
for (const button of viewer.querySelectorAll("[data-frame]")) {
  button.addEventListener("click", () => stepFrame(Number(button.dataset.frame)));
}
viewer.addEventListener("keydown", (event) => {
  const steps = { ArrowRight: [stepPanel, 1], ArrowLeft: [stepPanel, -1], ArrowDown: [stepFrame, 1], ArrowUp: [stepFrame, -1] };
  if (event.key in steps) {
    event.preventDefault();
    const [step, by] = steps[event.key];
    step(by);
  }
});

// A link into something folded up opens it.
function unfold() {
  const place = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!place) return;
  for (let above = place; above; above = above.parentElement) {
    if (above.tagName === "DETAILS") above.open = true;
  }
  if (place.classList.contains("card") && place.hidden) {
    filters.reset();
    // Now, because a hidden card cannot be scrolled to.
    filter();
  }
  place.scrollIntoView();
}
addEventListener("hashchange", unfold);
unfold();

const theme = document.getElementById("theme");
const themes = ["automatic", "light", "dark"];
function paint(name) {
  if (name === "automatic") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = name;
  theme.textContent = `Theme: ${name}`;
}
theme.hidden = false;
theme.addEventListener("click", () => {
  const now = document.documentElement.dataset.theme || "automatic";
  paint(themes[(themes.indexOf(now) + 1) % themes.length]);
});
