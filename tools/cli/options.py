"""Options that several commands have, written once: their names, what they take and what the help says of them."""

from __future__ import annotations

from typing import Annotated

import typer

Chapter = Annotated[
    str,
    typer.Argument(
        metavar="N|DIR", help="Number of the chapter, 1 or ch01, or the folder of a fork.", show_default=False
    ),
]
Runnable = Annotated[
    str,
    typer.Argument(
        metavar="N|N/STUDY|DIR",
        help="Number of the chapter, one of its studies, or the folder of a fork: 1, 1/first-triangle, my-ch01.",
        show_default=False,
    ),
]
Backend = Annotated[str, typer.Option(metavar="auto|vulkan|gl", help="Graphics API.")]
Scene = Annotated[str, typer.Option(metavar="NAME|PATH", help="As for `strata run`.")]
Environment = Annotated[
    str, typer.Option(metavar="FILE|sky|none", help="Light from far away: a panorama, .hdr or .exr.")
]
Size = Annotated[str, typer.Option(metavar="WxH", help="Size of the picture in pixels.")]
Camera = Annotated[
    str | None,
    typer.Option(metavar="NAME|VIEW", help="As for `strata run`.", show_default=False),
]
CameraPath = Annotated[
    str | None,
    typer.Option(
        "--path",
        metavar="NAME|FILE",
        help="Move the camera from where it stands: still, pan, walk, dolly or orbit, with values as in "
        "walk:speed=0.1, or by a .json file of key poses.",
        show_default=False,
    ),
]
Rate = Annotated[
    float | None,
    typer.Option(
        "--fps",
        metavar="RATE",
        help="Frames in a second of the clock, without a window: 60, and 50 for a .gif, which can show no more.",
        show_default=False,
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Turn a knob of `strata list N --settings`; repeatable."),
]
Without = Annotated[
    list[str] | None,
    typer.Option(metavar="FEATURE|all", help="Do as on a device that lacks it; repeatable."),
]
Validate = Annotated[
    bool,
    typer.Option("--validate", help="Check every call by the validation layers, as those of a fork are."),
]
Unchecked = Annotated[bool, typer.Option("--no-validate", help="Check no call, not even those of a fork.")]
Uncached = Annotated[
    bool,
    typer.Option(
        "--no-cache", help="Load the scene from its file, and keep nothing of it; from chapter 3 on."
    ),
]
Compress = Annotated[
    bool, typer.Option("--compress", help="Keep textures block-compressed: less memory, not the same bits.")
]
