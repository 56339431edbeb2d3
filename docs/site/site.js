// What moves on the pages of the site: the handle between two pictures, a choice among pairs, the numbers of a plot,
// a choice among features.
"use strict";

function overlay(figure) {
  const pair = figure.querySelector(".pair");
  const handle = figure.querySelector("input[type=range]");
  const show = () => pair.style.setProperty("--at", handle.value);
  handle.addEventListener("input", show);
  // The picture itself can be dragged, too.
  const drag = (event) => {
    if (event.type === "pointermove" && !event.buttons) return;
    const box = pair.getBoundingClientRect();
    handle.value = Math.round(100 * Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1));
    show();
  };
  pair.addEventListener("pointerdown", drag);
  pair.addEventListener("pointermove", drag);
  pair.addEventListener("dragstart", (event) => event.preventDefault());
  pair.style.touchAction = "pan-y";
  show();
}

// Without this script all pairs of a chapter stand below each other; with it, one is chosen from a list.
function choice(group) {
  const figures = [...group.querySelectorAll(".overlay")];
  if (figures.length < 2 || group.querySelector("select")) return;
  const label = document.createElement("label");
  label.className = "choose";
  label.append("Pictures: ");
  const list = document.createElement("select");
  figures.forEach((figure, index) => list.append(new Option(figure.dataset.title, index)));
  const show = () => figures.forEach((figure, index) => { figure.hidden = index !== Number(list.value); });
  list.addEventListener("change", show);
  label.append(list);
  group.prepend(label);
  show();
}

function plot(figure) {
  const said = figure.querySelector(".hover");
  const before = said.textContent;
  figure.querySelectorAll(".point").forEach((point) => {
    const tell = () => { said.textContent = point.getAttribute("aria-label"); };
    const end = () => { said.textContent = before; };
    point.addEventListener("pointerenter", tell);
    point.addEventListener("focus", tell);
    point.addEventListener("pointerleave", end);
    point.addEventListener("blur", end);
  });
}

// Of all features those that have some words in their name, their tests or what became of them.
function search(place) {
  if (place.firstChild) return;
  const groups = [...document.querySelectorAll(".features")];
  const rows = groups.flatMap((group) => [...group.querySelectorAll("tbody tr")]);
  const plain = (text) => text.toLowerCase().replace(/[-_\s]+/g, " ");
  const texts = rows.map((row) => plain(row.textContent));
  const label = document.createElement("label");
  const field = document.createElement("input");
  field.type = "search";
  const said = document.createElement("output");
  label.append("Features with the words ", field, " ", said);
  const show = () => {
    const words = plain(field.value).split(" ").filter(Boolean);
    rows.forEach((row, index) => { row.hidden = !words.every((word) => texts[index].includes(word)); });
    groups.forEach((group) => {
      const none = !group.querySelector("tbody tr:not([hidden])");
      group.hidden = none;
      group.previousElementSibling.hidden = none; // its heading
    });
    said.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length}`;
  };
  field.addEventListener("input", show);
  place.append(label);
  show();
}

// A chapter was one page once. An address of that time leads to the page that has the place now.
function moved() {
  const table = document.getElementById("moved-places");
  const place = decodeURIComponent(location.hash.slice(1));
  if (!table || !place || document.getElementById(place)) return;
  const to = JSON.parse(table.dataset.places)[place];
  if (to) location.replace(to);
}

function begin() {
  moved();
  document.querySelectorAll("figure.overlay").forEach(overlay);
  document.querySelectorAll(".overlays").forEach(choice);
  document.querySelectorAll("figure.plot").forEach(plot);
  document.querySelectorAll(".search-features").forEach(search);
  // What is wider than a phone is scrolled, and so has to be reached by keys.
  document.querySelectorAll(".md-typeset__scrollwrap, .md-typeset pre > code, .figure").forEach((wide) => {
    wide.tabIndex = 0;
  });
}

if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", begin);
else begin();
