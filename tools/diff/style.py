"""The look and the keys of the page of `strata diff`: one stylesheet and one script, written into the page."""

from __future__ import annotations

from collections.abc import Mapping

LIGHT = {
    "back": "#ffffff",
    "text": "#18181b",
    "soft": "#52525b",
    "line": "#d4d4d8",
    "card": "#f4f4f5",
    "link": "#1d4ed8",
    "add": "#e2f6e6",
    "del": "#fdeaea",
    "plus": "#14632a",
    "minus": "#9f1239",
    "k": "#6b21a8",
    "s": "#155e2b",
    "c": "#4b5563",
    "m": "#075985",
    "f": "#8a3206",
    "p": "#7c2d5b",
}
"""Colours by what they are for: paper and text, the paper of inserted and deleted lines, and kinds of code."""

DARK = {
    "back": "#16181d",
    "text": "#f4f4f5",
    "soft": "#b4b4bd",
    "line": "#3f3f46",
    "card": "#22252b",
    "link": "#93c5fd",
    "add": "#11301d",
    "del": "#421b1f",
    "plus": "#86efac",
    "minus": "#fda4af",
    "k": "#d8b4fe",
    "s": "#a7e3b4",
    "c": "#b6bdc7",
    "m": "#a5d4ff",
    "f": "#fdba74",
    "p": "#f5b8dc",
}


def _variables(colors: Mapping[str, str]) -> str:
    return "".join(f"--{name}: {value}; " for name, value in colors.items())


STYLE = (
    f"""
:root {{ color-scheme: light; {_variables(LIGHT)}}}
@media screen and (prefers-color-scheme: dark) {{
  :root:not([data-theme=light]) {{ color-scheme: dark; {_variables(DARK)}}} }}
@media screen {{ :root[data-theme=dark] {{ color-scheme: dark; {_variables(DARK)}}} }}
"""
    + """
* { box-sizing: border-box; }
body { font: 1rem/1.5 system-ui, sans-serif; margin: 0; background: var(--back); color: var(--text); }
main, .top { max-width: 80rem; margin: 0 auto; padding: 1rem; overflow-wrap: anywhere; }
a { color: var(--link); }
h1, h2 { line-height: 1.25; margin: .5rem 0; }
h2 { font-size: 1.3rem; }
.soft { color: var(--soft); }
.counts { font-variant-numeric: tabular-nums; white-space: nowrap; }
.plus { color: var(--plus); } .minus { color: var(--minus); }
nav table { border-collapse: collapse; width: 100%; }
nav td, nav th { text-align: left; padding: .25rem .6rem .25rem 0; border-bottom: 1px solid var(--line); }
nav .counts { text-align: right; }
nav .what { overflow-wrap: normal; }
section { border-top: 2px solid var(--line); margin-top: 2rem; padding-top: .8rem; }
ul.functions { columns: 22rem; padding-left: 1.2rem; margin: .5rem 0; }
.note { border-left: 4px solid var(--link); padding-left: .7rem; margin: .5rem 0; }
.step { margin: 1rem 0; border: 1px solid var(--line); border-radius: .4rem; overflow: hidden; }
.step:focus { outline: 3px solid var(--link); outline-offset: 2px; }
.where { background: var(--card); padding: .3rem .7rem; border-bottom: 1px solid var(--line); margin: 0;
  font-weight: 600; font-size: .9rem; }
.code { font: .85rem/1.5 ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", monospace; tab-size: 4; }
.l { display: grid; grid-template-columns: 4ch 2ch 1fr; border-left: 4px solid transparent; padding: 0 .4rem; }
.l > span { white-space: pre; color: var(--soft); user-select: none; -webkit-user-select: none; }
.l > span:first-child { text-align: right; padding-right: 1ch; }
.l > span.mark { padding-left: .5ch; font-weight: 700; color: inherit; }
.l code { font: inherit; white-space: pre-wrap; overflow-wrap: anywhere; min-width: 0; }
.add { background: var(--add); border-left-color: var(--plus); }
.del { background: var(--del); border-left-color: var(--minus); }
.pair { display: grid; grid-template-columns: minmax(0, 1fr) minmax(0, 1fr); }
.pair > div + div { border-left: 1px solid var(--line); }
.k { color: var(--k); } .s { color: var(--s); } .c { color: var(--c); font-style: italic; }
.m { color: var(--m); } .f { color: var(--f); } .p { color: var(--p); }
.pictures { display: flex; flex-wrap: wrap; gap: .6rem; padding: .6rem; }
.pictures figure { margin: 0; flex: 1 1 18rem; }
.pictures img { width: 100%; height: auto; display: block; image-rendering: pixelated; }
details > summary { cursor: pointer; padding: .6rem 0; font-weight: 600; }
.bar { position: sticky; top: 0; z-index: 2; background: var(--card); border-bottom: 1px solid var(--line);
  display: flex; flex-wrap: wrap; gap: .4rem; align-items: center; padding: .4rem 1rem; }
.bar button { font: inherit; color: inherit; background: var(--back); border: 1px solid var(--line);
  border-radius: .4rem; padding: .35rem .8rem; min-height: 2.6rem; cursor: pointer; }
.bar button:focus-visible, a:focus-visible, summary:focus-visible { outline: 3px solid var(--link); }
.bar .place { margin-left: auto; }
.skip { position: absolute; left: -100rem; }
.skip:focus { left: 0; background: var(--back); padding: .6rem; z-index: 3; }
.present main, .present .top { max-width: none; }
.present .top, .present nav, .present section:not(.current), .present .step:not(.current), .present summary,
.present ul.functions, .present .top .note { display: none; }
.present section { border: 0; margin: 0; padding: 0; }
.present h2, .present .sentence { font-size: clamp(1.1rem, 1.8vw, 1.9rem); margin: .2rem 0; }
.present .where { font-size: clamp(1rem, 1.5vw, 1.6rem); }
.present .code { font-size: clamp(max(1rem, 1.35vw), calc(92vw / (var(--columns) * .62)), 2.7rem); line-height: 1.35; }
.present .pictures img { max-height: 75vh; object-fit: contain; }
@media (max-width: 60rem) { .pair { grid-template-columns: minmax(0, 1fr); }
  .pair > div + div { border-left: 0; } .pair.both > div + div { display: none; }
  .l { grid-template-columns: 3.5ch 1.5ch 1fr; padding: 0 .2rem; } .code { font-size: .8rem; } main { padding: .5rem; }
  .present .code { --columns: var(--side); } .key { display: none; }
  .bar { padding: .3rem .5rem; }
  .bar button { padding: .3rem .5rem; font-size: .9rem; } .bar .place { font-size: .85rem; } }
@media print { .bar, .skip, nav { display: none; } main, .top { max-width: none; padding: 0; }
  .step { break-inside: auto; } .where, h2 { break-after: avoid; } .l { break-inside: avoid; }
  .code { font-size: 8pt; } .add, .del { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
"""
)

LECTURE = """
body.lecture #main, body.lecture .top, body:not(.lecture) #lecture { display: none; }
.notes { border-left: 4px solid var(--link); margin: .8rem; padding-left: .7rem; }
.drawing { padding: .6rem; } .drawing svg, .drawing img { max-width: 100%; height: auto; display: block; }
.present .drawing svg, .present .drawing img { width: auto; height: auto; max-height: 60vh;
  min-width: min(100%, 60vw); }
.present:not(.spoken) .notes { display: none; }
.present .notes { font-size: clamp(1rem, 1.5vw, 1.6rem); }
"""
"""For a page with a lecture: its stops in place of the difference. Notes are hidden in large type."""

SCRIPT = """
"use strict";
const root = document.documentElement, body = document.body;
const place = document.getElementById("place");
let current = null;
const inLecture = () => body.classList.contains("lecture");
const steps = () => [...document.querySelectorAll(".step")].filter(
  (s) => !s.closest("details:not([open])") && Boolean(s.closest("#lecture")) === inLecture());
function toggle(name, button, on) {
  body.classList.toggle(name);
  document.getElementById(button).setAttribute("aria-pressed", body.classList.contains(name) === on);
}
function full() {
  if (!document.getElementById("full")) return;
  toggle("lecture", "full", false);
  current = null;
  if (presenting()) go(steps()[0]);
  else scrollTo(0, 0);
}
const spoken = () => document.getElementById("notes") && toggle("spoken", "notes", true);
function go(step) {
  document.querySelectorAll(".current").forEach((e) => e.classList.remove("current"));
  current = step;
  step.classList.add("current");
  step.closest("section").classList.add("current");
  const all = steps();
  place.textContent = `${all.indexOf(step) + 1} of ${all.length}: ${step.getAttribute("aria-label")}`;
  step.focus({ preventScroll: true });
  if (presenting()) scrollTo(0, 0);
  else step.scrollIntoView({ block: "start" });
}
const presenting = () => body.classList.contains("present");
function present(on) {
  body.classList.toggle("present", on);
  document.getElementById("present").setAttribute("aria-pressed", on);
  if (on) go(current || steps()[0]);
  else if (current) current.scrollIntoView({ block: "center" });
}
function move(by) {
  const all = steps();
  if (!all.length) return;
  if (!presenting()) return present(true);
  const next = all.indexOf(current) + by;
  if (next >= 0 && next < all.length) go(all[next]);
}
function theme() {
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
}
const below = () => innerHeight + scrollY < document.body.scrollHeight - 4;
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const key = event.key;
  if (key === "ArrowRight" || (key === "PageDown" && presenting())) move(1);
  else if (key === "ArrowLeft" || (key === "PageUp" && presenting())) move(-1);
  else if (key === "ArrowDown" && presenting() && !below()) move(1);
  else if (key === "ArrowUp" && presenting() && scrollY === 0) move(-1);
  else if (key === "Home" && presenting()) go(steps()[0]);
  else if (key === "End" && presenting()) go(steps().at(-1));
  else if (key === "Escape" && presenting()) present(false);
  else if (key === "p") present(!presenting());
  else if (key === "d") theme();
  else if (key === "f") full();
  else if (key === "n") spoken();
  else return;
  event.preventDefault();
});
document.addEventListener("focusin", (event) => {
  if (event.target.classList.contains("step") && !presenting()) current = event.target;
});
document.getElementById("present").onclick = () => present(!presenting());
document.getElementById("back").onclick = () => move(-1);
document.getElementById("on").onclick = () => move(1);
document.getElementById("theme").onclick = theme;
for (const [name, act] of [["full", full], ["notes", spoken]]) {
  const button = document.getElementById(name);
  if (button) button.onclick = act;
}
document.querySelectorAll("nav a").forEach((link) => {
  link.onclick = () => {
    const inside = document.querySelector(link.getAttribute("href"));
    const folded = inside && inside.closest("details");
    if (folded) folded.open = true;
  };
});
let opened = [];
addEventListener("beforeprint", () => {
  opened = [...document.querySelectorAll("details:not([open])")];
  opened.forEach((e) => { e.open = true; });
});
addEventListener("afterprint", () => opened.forEach((e) => { e.open = false; }));
"""
