"""The notebook of examples/: run cell by cell as Jupyter would, its numbers held to the scene and to metrics."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from common.paths import ROOT
from common.reports.metrics import relative_mse
from common.scene.pose import evaluate_pose
from tools.run import notebooks

PATH = ROOT / "examples" / "notebook.ipynb"
MOST_BYTES = 150_000


@pytest.fixture(scope="module")
def ran() -> tuple[dict[str, Any], list[notebooks.Cell]]:
    """The names that the notebook leaves, and its cells with what they showed."""
    cells = notebooks.read(PATH)
    return notebooks.run(cells), cells


def shown_by(ran, words: str) -> list[str]:
    """Return what the one cell of code showed in which these words stand."""
    (found,) = (cell.shown for cell in ran[1] if cell.kind == "code" and words in cell.text)
    return found


def test_a_frame_is_a_picture_with_its_time_and_work(ran):
    (html,) = shown_by(ran, "view = chapters.view_of")
    assert "data:image/png;base64," in html and "forward, GPU ms" in html
    depth, ids = shown_by(ran, 'frame.show("depth")')
    assert "distance from white" in depth and "a hue for each id" in ids
    assert "Chapter 1, cornell" in shown_by(ran, "renderer = chapters.open")[0]
    base_color, normal, names = shown_by(ran, "inspect=True")
    assert (
        "gbuffer_base_color:" in base_color
        and "directions: x, y, z" in normal
        and "lighting/color_lit" in names
    )
    assert all(cell.shown for cell in ran[1][:-1] if cell.kind == "code")


def test_distances_are_those_of_the_scene(ran):
    """The corners that are nearest and farthest along the camera's axis are both in the picture."""
    space = ran[0]
    scene, view = space["scene"], space["view"]
    ahead = []
    for world, mesh in zip(evaluate_pose(scene, 0.0).world_from_object, scene.instances.mesh, strict=True):
        row = scene.meshes[mesh]
        vertices = scene.positions[row["first_vertex"] :][: row["vertex_count"]]
        view_from_object = view.view_from_world() @ world
        ahead.append(-(vertices @ view_from_object[2, :3] + view_from_object[2, 3]))
    every = np.concatenate(ahead)
    assert np.isclose(space["distance"].min(), every.min(), rtol=0.01)
    assert np.isclose(space["distance"].max(), every.max(), rtol=0.01)


def test_more_samples_are_worth_it_and_the_error_is_the_metric_s(ran):
    """Of pixels that hold the mean of 4 places, the squares should fall to a quarter or less."""
    space = ran[0]
    truth, (one, four) = space["truth"], (float(row[2]) for row in space["rows"])
    assert four < one / 4
    assert np.isclose(space["error"](space["light"]), relative_mse(space["light"], truth), rtol=1e-3)
    assert np.isclose(one, relative_mse(space["light"], truth), rtol=0.01)  # printed with three digits
    assert "pixels changed" in shown_by(ran, "compared({")[0]


def test_it_closes_what_it_opened(ran):
    assert ran[0]["renderer"]._closed and ran[0]["smoother"]._closed


def test_the_file_is_small_without_outputs_and_as_the_format_wants():
    read = json.loads(PATH.read_text("utf-8"))
    assert PATH.stat().st_size < MOST_BYTES
    assert (read["nbformat"], read["nbformat_minor"]) == (4, 5)
    names = [cell["id"] for cell in read["cells"]]
    assert len({*names}) == len(names)
    for cell in read["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [] and cell["execution_count"] is None


# --- how notebooks are run --------------------------------------------------------------------------------------------


def run(*code: str) -> list[list[str]]:
    cells = [notebooks.Cell("code", text) for text in code]
    notebooks.run([notebooks.Cell("markdown", "no code at all"), *cells])
    return [cell.shown for cell in cells]


def test_what_is_printed_and_what_is_shown_stay_in_order():
    table = "from tools.run.shown import Table\nTable('t', ['<a>'], [['b']])"
    shown = run("a = 1\nprint('one <', a)\nprint('two')\n2 * a", f"{table}\nprint(a)", table, "a = 2", "None")
    assert shown[0] == ["<pre>one &lt; 1\ntwo\n</pre>", "<pre>2</pre>"]
    assert shown[1] == ["<pre>1\n</pre>"]
    assert len(shown[2]) == 1 and shown[2][0].startswith("<table>")
    assert shown[3:] == [[], []]


def test_pictures_between_lines_are_between_them():
    picture = "from tools.run.shown import Picture\nimport numpy as np\nPicture(np.zeros((2, 2, 3), np.uint8)).show()"
    (shown,) = run(f"print(1)\n{picture}\nprint(2)\nprint(3)")
    assert [shown[0], shown[2]] == ["<pre>1\n</pre>", "<pre>2\n3\n</pre>"] and shown[1].startswith("<figure")


def test_a_cell_that_fails_stops_it_and_pictures_go_where_they_went_before(monkeypatch):
    from tools.run import shown

    with pytest.raises(ZeroDivisionError):
        run("1 / 0", "pytest.fail('it went on')")
    assert shown.notebook_display() is None
