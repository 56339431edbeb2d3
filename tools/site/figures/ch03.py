"""Figures of chapter 3: tasks on threads, a texture's way over two queues, the staging ring, parts, the cache file."""

from __future__ import annotations

from .canvas import Canvas

DURATIONS = {
    "read": 2.0,
    **{f"decode {i}": d for i, d in enumerate((4.0, 3.0, 5.0, 2.0, 3.0))},
    "geometry": 4.0,
}
THREADS = 3
UPLOAD_MS = 0.7


def schedule() -> list[tuple[str, int, float, float]]:
    """Return (task, thread, start, end): list scheduling in the order of the table; uploads run on the last thread."""
    free = [0.0] * THREADS
    ends: dict[str, float] = {}
    planned: list[tuple[str, int, float, float]] = []
    uploads: list[tuple[float, str]] = []
    for name, length in DURATIONS.items():
        ready = 0.0 if name == "read" else ends["read"]
        thread = min(range(THREADS), key=lambda one: (max(free[one], ready), one))
        start = max(free[thread], ready)
        free[thread] = ends[name] = start + length
        planned.append((name, thread, start, start + length))
        if name != "read":
            uploads.append((ends[name], name))
    now = 0.0
    for ready, name in sorted(uploads):
        now = max(now, ready)
        planned.append((f"upload {name.rpartition(' ')[2]}", THREADS, now, now + UPLOAD_MS))
        now += UPLOAD_MS
    return planned


def tasks_on_threads() -> Canvas:
    """A load as tasks on three worker threads, and its uploads on the one thread that may call the API."""
    c = Canvas(760, 280, "The tasks of a load on worker threads and the render thread, over time")
    planned = schedule()
    left, scale = 120, 610 / max(end for *_, end in planned)
    for thread in range(THREADS + 1):
        y = 40 + 48 * thread
        c.text(12, y + 20, f"worker {thread}" if thread < THREADS else "render thread")
        c.line([(left, y + 34), (745, y + 34)], "card", 1)
    for name, thread, start, end in planned:
        kind = "f" if name == "read" else "b" if name == "geometry" else "a" if "decode" in name else "c"
        short = "" if name.startswith("upload") else name
        c.box(left + scale * start, 40 + 48 * thread, scale * (end - start), 30, short, kind, 12)
    c.arrow(left, 236, 745, 236)
    c.text(745, 254, "time", 12, "end", "soft")
    c.text(
        12,
        254,
        "green: uploads, pinned to the render thread; each begins when its task has ended",
        12,
        role="soft",
    )
    c.note(12, 270, "A task that waits for another one takes no thread.")
    return c


def ownership_transfer() -> Canvas:
    """A texture's upload: copies on the transfer queue, then release, semaphore and acquire, then sampling."""
    c = Canvas(760, 270, "A texture is copied on the transfer queue and handed over to the graphics queue")
    for y, name in ((70, "transfer queue"), (170, "graphics queue")):
        c.text(12, y + 22, name, bold=True)
        c.line([(140, y + 46), (745, y + 46)], "card", 1)
    c.box(140, 70, 110, 36, "undefined →\ncopy target", "f", 11)
    c.box(256, 70, 130, 36, "copy all levels", "a", 12)
    c.box(392, 70, 96, 36, "release", "d", 12)
    c.box(140, 170, 250, 36, "frames draw with a placeholder", "card", 12)
    c.box(528, 170, 96, 36, "acquire", "d", 12)
    c.box(630, 170, 116, 36, "sample it", "c", 12)
    c.line([(488, 88), (508, 88), (508, 188), (528, 188)], "mark", 2, arrow=True)
    c.note(516, 136, "semaphore", "mark")
    c.note(140, 40, "release and acquire are one barrier in two halves:")
    c.note(140, 56, "same image, same layouts, same queue families")
    c.text(
        140,
        250,
        "The halves have to agree: otherwise the texels may still be in the other queue's caches.",
        12,
        role="soft",
    )
    return c


RING = 16
"""Units of the ring in the figure."""


def staging_ring() -> Canvas:
    """The staging ring with uploads in flight: head, tail, and the levels of a texture that one range holds."""
    c = Canvas(760, 290, "The staging ring: ranges of uploads in flight between tail and head")
    taken = [("texture 4", 3, 5, "b"), ("texture 5", 8, 3, "a"), ("texture 6", 11, 3, "a")]
    left, unit, y = 20, 45, 70
    for i in range(RING):
        c.box(left + unit * i, y, unit, 44, "", "paper", round=0)
    for name, first, count, fill in taken:
        c.box(left + unit * first, y, unit * count, 44, name, fill, round=0)
    c.arrow(left + unit * 3, 42, left + unit * 3, y, "mark")
    c.text(left + unit * 3, 34, "tail: first byte in use", 12, "middle", "mark")
    c.arrow(left + unit * 14, 42, left + unit * 14, y, "mark")
    c.text(left + unit * 14, 34, "head: next free byte", 12, "middle", "mark")
    c.text(
        left,
        134,
        "yellow: its submission has ended, so the tail may follow; blue: the GPU still copies",
        12,
        role="soft",
    )
    c.text(20, 172, "a range holds all mip levels of a texture", bold=True)
    x = 20.0
    for level in range(6):
        wide = 256 / 2 ** (1.2 * level) + 8
        c.box(x, 186, wide, 40, f"level {level}" if wide > 60 else str(level), "a", 11, round=0)
        x += wide
    side, x = 80, 560
    for level in range(4):
        c.box(x, 160, side / 2**level, side / 2**level, "", "c", round=0)
        x += side / 2**level + 6
    c.arrow(530, 206, 554, 206)
    c.text(
        20,
        262,
        "One copy command per texture writes all levels. When the ring ends, the next upload begins at 0;",
        12,
        role="soft",
    )
    c.note(20, 278, "an upload that finds no room waits for the tail.")
    return c


PARTS = 6


def recording_in_parts() -> Canvas:
    """A list of draws cut into parts; threads record secondaries, and the primary executes them in order."""
    c = Canvas(760, 280, "A list of draws is cut into parts that threads record")
    c.text(12, 30, "draws, in their order", bold=True)
    for part in range(PARTS):
        x = 12 + 124 * part
        c.box(x, 40, 118, 30, f"part {part}", "ab"[part % 2])
        thread = part % 3
        c.box(x, 112, 118, 44, f"secondary {part}\non thread {thread}", "cde"[thread], 12)
        c.arrow(x + 59, 70, x + 59, 112)
        c.arrow(x + 59, 156, x + 59, 196)
    c.box(12, 196, 738, 34, "primary: execute secondaries 0 to 5 in this order", "f")
    c.text(
        12, 254, "Each thread records into a command pool of its own, in each frame slot.", 12, role="soft"
    )
    c.text(
        12,
        270,
        "Which thread records a part does not change the commands, and so not the picture.",
        12,
        role="soft",
    )
    return c


def cache_file() -> Canvas:
    """The file of the scene cache: a key, a table of sections, and blocks that are read in place."""
    c = Canvas(760, 250, "The file of the scene cache and what it is a cache of")
    c.box(12, 60, 150, 110, "scene.gltf\nscene.bin\nimages", "b", 13)
    c.box(220, 84, 130, 62, "path, program and\nsource files match?", "d", 12)
    c.arrow(162, 115, 220, 115)
    c.arrow(400, 115, 350, 115)
    c.text(400, 48, "one file, mapped into memory", bold=True)
    parts = (("header", "f", 60), ("table of sections", "a", 110), ("geometry", "c", 84), ("texels", "e", 92))
    x = 400
    for name, fill, wide in parts:
        c.box(x, 84, wide, 62, name.replace(" of ", " of\n"), fill, 12, round=0)
        x += wide
    for x0, x1 in ((508, 612), (540, 700)):
        c.curve((x0, 146), ((x0 + x1) / 2, 196), (x1, 148), "mark")
    c.note(400, 206, "the table says where each section lies")
    c.text(
        12,
        236,
        "A cache that does not match its sources, or has a wrong checksum, is made again.",
        12,
        role="soft",
    )
    return c


FIGURES = {
    "ch03-tasks-on-threads": tasks_on_threads,
    "ch03-ownership-transfer": ownership_transfer,
    "ch03-staging-ring": staging_ring,
    "ch03-recording-in-parts": recording_in_parts,
    "ch03-cache-file": cache_file,
}
