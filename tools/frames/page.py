"""The page of `strata frame`: one file that works offline, with links to the pictures beside it, light or dark."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tools.frames.frame import Frame, Output, Resource, Step

STYLE = """
:root { color-scheme: light dark; --line: #d4d4d8; --soft: #52525b; --back: #fff; --card: #f4f4f5; --text: #18181b;
  --link: #1d4ed8; }
@media (prefers-color-scheme: dark) { :root { --line: #3f3f46; --soft: #a1a1aa; --back: #18181b; --card: #27272a;
  --text: #f4f4f5; --link: #93c5fd; } }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 0 auto; padding: 1.5rem; background: var(--back);
  color: var(--text); }
a { color: var(--link); }
h1, h2 { line-height: 1.2; }
h2 { margin: 0; }
table { border-collapse: collapse; margin: .5rem 0; }
th, td { text-align: left; padding: .2rem .9rem .2rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
section { border-top: 2px solid var(--line); padding: 1.2rem 0; margin-top: 1.5rem; }
.soft { color: var(--soft); }
.outputs { display: flex; flex-wrap: wrap; gap: 1rem; }
figure { margin: .5rem 0; flex: 1 1 24rem; max-width: 100%; background: var(--card); padding: .6rem;
  border-radius: .4rem; }
figure:target { outline: 3px solid var(--link); }
img { max-width: 100%; height: auto; display: block; image-rendering: auto; }
figcaption { padding-top: .4rem; }
"""


def page(frame: Frame) -> str:
    """Return the whole page as HTML."""
    title = f"A frame of {frame.of}: {frame.scene}"
    settings = ", ".join(f"{name} {value}" for name, value in frame.settings.items())
    facts = [
        f"{frame.title}",
        f"{frame.size[0]}x{frame.size[1]} at {frame.time:g} s on {frame.device}, {frame.backend}",
        f"The CPU took {frame.cpu_ms:.2f} ms to record it",
        *([f"Settings other than medium's: {settings}"] if settings else []),
        *([f"Left out after the last pass shown: {', '.join(frame.left_out)}"] if frame.left_out else []),
    ]
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>",
        f"<h1>{escape(title)}</h1>",
        "".join(f'<p class="soft">{escape(fact)}.</p>' for fact in facts),
        _overview(frame),
        *([_skipped(frame)] if frame.skipped else []),
        *([_resources(frame)] if frame.resources else []),
        *(_section(step) for step in frame.steps),
        '<section><h2>All of it</h2><p><a href="contact.png"><img src="contact.png" alt="contact sheet of every'
        ' output"></a></p>',
        f'<p class="soft">{escape(_words(frame.work))}.</p></section>',
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _overview(frame: Frame) -> str:
    rows = [
        f'<tr><td><a href="#{escape(step.name)}">{step.number}. {escape(step.name)}</a></td>'
        f'<td class="number">{step.gpu_ms:.2f}</td><td class="number">{step.work.get("draws", 0)}</td>'
        f"<td>{_links(step.reads)}</td><td>{_links(step.writes)}</td></tr>"
        for step in frame.steps
    ]
    numbers = "".join(f'<th class="number">{name}</th>' for name in ("GPU ms", "draws"))
    head = f"<tr><th>pass</th>{numbers}<th>reads</th><th>writes</th></tr>"
    return f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"


def _skipped(frame: Frame) -> str:
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(why)}</td></tr>" for name, why in frame.skipped.items()
    )
    return f"<h2>Left out of this frame</h2><table><tbody>{rows}</tbody></table>"


def _resources(frame: Frame) -> str:
    """The images and buffers of the frame graph, in the order in which they come to life."""
    rows = []
    for one in frame.resources:
        size = f"{one.size[0]}x{one.size[1]}" if one.size else ""
        samples = f", {one.samples} samples a pixel" if one.samples > 1 else ""
        rows.append(
            f"<tr><td>{escape(', then '.join(one.names))}</td><td>{escape(one.life)}</td>"
            f'<td>{escape(one.format + samples)}</td><td class="number">{size}</td>'
            f'<td class="number">{one.bytes / 1024:,.1f}</td><td>{escape(one.first)}</td>'
            f"<td>{escape(one.last)}</td></tr>"
        )
    head = (
        '<tr><th>name</th><th>life</th><th>format</th><th class="number">size</th><th class="number">KiB</th>'
        "<th>from</th><th>to</th></tr>"
    )
    return (
        f"<h2>Resources</h2><table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"
        '<p class="soft">Here each has memory of its own, since all of them are looked at: '
        f"<code>strata graph {frame.chapter}</code> shows which share it otherwise.</p>"
    )


def _links(resources: list[Resource] | list[Output]) -> str:
    return ", ".join(_link(one) for one in resources) or "nothing of the frame"


def _link(one: Resource) -> str:
    if not one.written_by:
        return escape(one.name)
    return f'<a href="#{escape(_anchor(one))}">{escape(one.name)}</a>'


def _anchor(one: Resource) -> str:
    return f"{one.written_by}-{one.name}"


def _section(step: Step) -> str:
    reads = "".join(
        f"<tr><td>{_link(one)}</td><td>{escape(_kind(one))}</td><td>written by {escape(one.written_by)}</td></tr>"
        for one in step.reads
    )
    inputs = f"<h3>Reads</h3><table>{reads}</table>" if reads else ""
    figures = "".join(
        f'<figure id="{escape(_anchor(one))}"><a href="{escape(one.file)}"><img src="{escape(one.file)}"'
        f' alt="{escape(one.name)} after {escape(step.name)}" width="{one.size[0]}" height="{one.size[1]}"></a>'
        f"<figcaption><b>{escape(one.name)}</b> {escape(_kind(one))}<br>"
        f'<span class="soft">{escape(one.mapping)}</span></figcaption></figure>'
        for one in step.writes
    )
    return (
        f'<section id="{escape(step.name)}"><h2>{step.number}. {escape(step.name)}</h2>'
        f"<p>{escape(step.sentence)}</p><p>{step.gpu_ms:.2f} ms on the GPU; {escape(_words(step.work))}.</p>"
        f'{inputs}<h3>Writes</h3><div class="outputs">{figures}</div></section>'
    )


def _kind(one: Resource) -> str:
    samples = f", {one.samples} samples a pixel" if one.samples > 1 else ""
    return f"{one.format}, {one.size[0]}x{one.size[1]}{samples}, as {one.use}"


def _words(work: dict[str, int]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in work.items())
