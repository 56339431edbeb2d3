"""Key poses of a camera in a JSON file, and what is between them.

    {"keys": [
      {"time": 0, "eye": [3, 2, 5], "target": [0, 1, 0]},
      {"time": 1.5, "eye": [1, 2, 5], "target": [0, 1, 0]}
    ]}

Times are seconds from the first frame, each later than the one before. Positions are metres in the world. Before its
first key pose the camera stands at that one, behind the last at that.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError
from common.files.regular_files import read_regular
from common.names import shortened, suggest, visible
from common.numerics.transforms import compose, pose_looking_at, quaternion_from_matrix, slerp
from common.scene import NUMBER_LIMIT

Float64 = NDArray[np.float64]

MAX_BYTES = 4 << 20
"""The largest file; ten thousand key poses take less."""
MAX_TIME_S = 1e6
FIELDS = ("time", "eye", "target")


@dataclass(frozen=True, eq=False)
class KeyPoses:
    """Key poses: `times` (K,) in seconds, rising, `eyes` (K, 3) in metres, `turns` (K, 4) quaternions xyzw."""

    times: Float64
    eyes: Float64
    turns: Float64

    def pose(self, time: float) -> Float64:
        """Return the (4, 4) rigid pose at a time in seconds, interpolated between the two keys around it.

        The position is the cubic of Hermite through both keys with the slopes of Catmull and Rom (1974, "A class of
        local interpolating splines") for keys at uneven times, (p[k+1] - p[k-1]) / (t[k+1] - t[k-1]), and at both ends
        the slope to the neighbour. The orientation goes along the shorter arc at a constant rate (Shoemake 1985).
        """
        times, last = self.times, len(self.times) - 1
        if last == 0 or time <= times[0] or time >= times[-1]:
            end = 0 if last == 0 or time <= times[0] else last
            return compose(self.eyes[end], self.turns[end], (1.0, 1.0, 1.0))
        k = int(np.searchsorted(times, time, side="right")) - 1
        span = times[k + 1] - times[k]
        s = (time - times[k]) / span
        # Relative to the first of both keys: far from the origin the sums of the cubic would lose digits.
        way = self.eyes[k + 1] - self.eyes[k]
        eye = self.eyes[k] + (
            (s * s * (3 - 2 * s)) * way
            + span * (s * (1 - s) ** 2 * self._slope(k) - s * s * (1 - s) * self._slope(k + 1))
        )
        return compose(eye, slerp(self.turns[k], self.turns[k + 1], s), (1.0, 1.0, 1.0))

    def _slope(self, k: int) -> Float64:
        """Return the velocity (3,) at key `k`, in metres per second."""
        before, after = max(k - 1, 0), min(k + 1, len(self.times) - 1)
        return (self.eyes[after] - self.eyes[before]) / (self.times[after] - self.times[before])


def read_keys(path: Path) -> KeyPoses:
    """Return the key poses of a file.

    Raises UserError of one sentence with the file and the place in it: no such file, no JSON, a key that is missing,
    numbers that are none, times that do not rise.
    """
    shown = visible(str(path))
    try:
        data = read_regular(path, MAX_BYTES + 1)
    except FileNotFoundError:
        raise UserError(f"There is no file {shown} with the key poses of a path.") from None
    except IsADirectoryError:
        raise UserError(f"{shown} is a folder: --path takes a .json file of key poses.") from None
    except (OSError, ValueError) as error:
        raise UserError(f"{shown} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    if len(data) > MAX_BYTES:
        raise UserError(f"{shown} has more than {MAX_BYTES >> 20} MiB: that is no file of key poses.")
    try:
        document = json.loads(data.decode("utf-8"), parse_constant=_no_constant)
    except UnicodeDecodeError as error:
        raise UserError(f"{shown} is no text in UTF-8: byte {error.start} belongs to none.") from None
    except json.JSONDecodeError as error:
        raise UserError(f"{shown}:{error.lineno}:{error.colno} is no JSON: {error.msg}.") from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"{shown} is no JSON of key poses: {error}.") from None
    return keys_of(document, shown)


def _no_constant(word: str) -> NoReturn:
    raise ValueError(f"{word} is no number in JSON")


def keys_of(document: Any, file: str) -> KeyPoses:
    """Return the key poses of a JSON document; `file` begins the sentences of errors. Raises UserError."""
    keys = document.get("keys") if isinstance(document, dict) else None
    if not isinstance(keys, list) or not keys:
        raise UserError(
            f'{file} has no key poses: write {{"keys": [{{"time": 0, "eye": [3, 2, 5], "target": [0, 1, 0]}}]}}.'
        )
    times, poses = [], []
    for index, key in enumerate(keys):
        place = f"{file}: keys[{index}]"
        if not isinstance(key, dict):
            raise UserError(f"{place} is {_brief(key)}: a key pose is an object with time, eye and target.")
        for name in key:
            if name not in FIELDS:
                near = suggest(visible(name), FIELDS)
                end = "" if near.endswith("?") else "."
                raise UserError(f"{place} has a field {shortened(visible(name), 40)!r}{near}{end}")
        missing = [name for name in FIELDS if name not in key]
        if missing:
            raise UserError(f"{place} lacks {' and '.join(missing)}: a key pose has time, eye and target.")
        time = key["time"]
        if not _is_number(time) or not 0 <= time <= MAX_TIME_S:
            raise UserError(
                f"{place}.time is {_brief(time)}: give seconds from the first frame, 0 to {MAX_TIME_S:g}."
            )
        if times and time <= times[-1]:
            raise UserError(
                f"{place}.time is {time:g}, but the key before is at {times[-1]:g}: each key is later than the last."
            )
        eye, target = (_point(key[name], f"{place}.{name}") for name in ("eye", "target"))
        if (eye == target).all():
            raise UserError(f"{place} looks at the point where it stands: move the eye or the target.")
        times.append(float(time))
        poses.append(pose_looking_at(eye, target))
    matrices = np.array(poses)
    return KeyPoses(np.array(times), matrices[:, :3, 3].copy(), quaternion_from_matrix(matrices))


def _point(value: Any, place: str) -> Float64:
    """Return three coordinates (3,) in metres."""
    numbers = value if isinstance(value, list) else []
    if len(numbers) != 3 or not all(_is_number(n) and abs(n) <= NUMBER_LIMIT for n in numbers):
        raise UserError(
            f"{place} is {_brief(value)}: give x, y and z in metres, as [3, 2, 5], none beyond {NUMBER_LIMIT:g}."
        )
    return np.array(numbers, np.float64)


def _is_number(value: Any) -> bool:
    """Whether a value of JSON is a finite number; true and false are none, and 1e999 is infinite."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    return isinstance(value, int) or math.isfinite(value)


def _brief(value: Any) -> str:
    return shortened(visible(json.dumps(value, ensure_ascii=False)), 40)
