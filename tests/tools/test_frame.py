"""`strata frame`: every output of every pass, on both backends, and the page that shows them."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import chapters
from chapters import scenes
from chapters.ch01.settings import Settings
from common.errors import StaleFrameError
from common.images import palette, read_image
from common.view.camera import exposure
from tests.common.gltf.builder import triangle
from tests.support.chapter import Chapter
from tests.support.drivers import checked

SIZE = (48, 32)

KEYS = {
    *("chapter", "title", "scene", "backend", "device", "size", "time", "settings", "work", "cpu_ms"),
    *("left_out", "skipped", "resources", "steps", "fork"),
}
"""Of the record of `--json`; scripts read it by these names."""
STEP_KEYS = {"number", "name", "sentence", "gpu_ms", "work", "reads", "writes"}
RESOURCE_KEYS = {"name", "use", "format", "size", "samples", "written_by"}


def both(vulkan_device, gl_context) -> list[Chapter]:
    return [Chapter(1, "vulkan", vulkan_device), Chapter(1, "gl", gl_context)]


def inspected(chapter, settings):
    """Return what each pass wrote, its work, the frame's, the passes' names, and the frame's own outputs."""
    scene = scenes.load("cornell")
    with chapter.open(scene, SIZE, settings, inspect=True) as renderer:
        view = chapters.view_of(renderer)
        for _ in range(3):
            frame = renderer.render(view)
        written = {name: frame.image(name) for name in renderer.inspection.names}
        own = {name: frame.image(name) for name in renderer.outputs}
        declared = [f"{one.name}/{access.resource}" for one in renderer.passes for access in one.writes]
        assert declared == list(written)
        return written, dict(renderer.inspection.work.by_pass), frame.work, list(frame.timings), own, view


@pytest.mark.feature("tools/frame")
@pytest.mark.parametrize("msaa", [1, 4])
def test_every_output_of_every_pass_is_the_same_on_both_backends(msaa, vulkan_device, gl_context):
    found = [inspected(chapter, Settings(msaa=msaa)) for chapter in both(vulkan_device, gl_context)]
    (a, work, total, passes, own, view), (b, other_work, *_) = found
    software = vulkan_device.capabilities.is_software and gl_context.capabilities.is_software
    assert list(a) == list(b)
    assert {name.split("/")[1] for name in a} >= {"color_hdr", "depth", "instance_id", "color"}
    for name in a:
        assert a[name].shape[:2] == SIZE[::-1] and a[name].dtype == b[name].dtype
        assert len(np.unique(a[name])) > 2
        one, two = a[name].astype(np.float64), b[name].astype(np.float64)
        if not software:  # an edge, or a step of a format, may fall on either side: in few places
            step = 2.0 if a[name].dtype == np.uint8 else 0.0
            assert np.isclose(one, two, rtol=1e-2, atol=step).mean() > 0.98
        elif a[name].dtype == np.uint8:
            assert np.abs(one - two).max() <= 1
        elif "color" in name:
            assert (np.abs(one - two) <= 2.0**-10 * np.abs(one) + 2.0**-24).all()
        else:
            assert np.array_equal(one, two)
    # What the last writer left is what the frame gives.
    last = {name.split("/")[1]: values for name, values in a.items()}
    assert np.array_equal(last["depth"], own["depth"])
    assert np.array_equal(last["instance_id"], own["instance_id"])
    assert np.array_equal(last["color"][..., :3], own["color"])
    light = last["color_hdr"][..., :3].astype(np.float32) / np.float32(exposure(view.ev100))
    assert np.array_equal(light, own["color_linear"])
    # The work of the passes is the work of the frame.
    assert list(work) == passes
    for counter in ("draws", "triangles", "pipeline_binds", "descriptor_binds"):
        assert sum(each[counter] for each in work.values()) == total[counter]
    assert all(work[name]["draws"] == other_work[name]["draws"] for name in work)


def test_several_samples_are_shown_by_their_mean(vulkan_device, gl_context):
    """The plain mean of the samples is what `resolve=linear` writes a pass later."""
    for chapter in both(vulkan_device, gl_context):
        written = inspected(chapter, Settings(msaa=4, resolve="linear", color_format="rgba32f"))[0]
        mean, resolved = written["forward/color_msaa"], written["resolve/color_hdr"]
        assert np.allclose(mean, resolved, rtol=1e-5, atol=1e-6)


def test_looking_changes_nothing_and_costs_nothing_when_nobody_looks(vulkan_device, gl_context):
    scene, picture = scenes.load("cornell"), {}
    for chapter in both(vulkan_device, gl_context):
        copies = {}
        for inspect in (False, True):
            with chapter.open(scene, SIZE, Settings(), inspect=inspect) as renderer:
                view = chapters.view_of(renderer)
                renderer.render(view)
                with chapter.calls() as calls:
                    frame = renderer.render(view)
                    picture[inspect] = frame.image("color")
                copies[inspect] = sum(
                    name in ("vkCmdCopyImageToBuffer", "glGetTextureSubImage") for name in calls
                )
                if not inspect:
                    assert renderer.inspection.names == () and renderer.inspection.work.by_pass == {}
                    with pytest.raises(StaleFrameError):
                        frame.image("forward/depth")
        assert np.array_equal(picture[False], picture[True])
        assert copies == {False: 1, True: 4 + 4}  # the outputs of the frame, and those of its passes


def test_what_is_looked_at_follows_the_size(vulkan_device, gl_context):
    for chapter in both(vulkan_device, gl_context):
        with chapter.open(scenes.load("cornell"), SIZE, Settings(msaa=4), inspect=True) as renderer:
            renderer.render(chapters.view_of(renderer))
            renderer.resize((20, 10))
            frame = renderer.render(chapters.view_of(renderer))
            assert frame.image("forward/color_msaa").shape == (10, 20, 4)


@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_the_page_shows_all_there_is(strata, tmp_path, vulkan_instance, backend):
    scene = triangle().write(tmp_path)
    code, out, err = strata(
        *("frame", "1", "--backend", backend, "--scene", scene, "--size", "48x32", "--set", "msaa=4"),
        *(*checked(vulkan_instance, backend), "--json", "frame.json"),
    )
    assert code == 0, err
    assert "resolve" in out and err.count("\n") == 1 and "index.html" in err
    folder = tmp_path / "out" / "frame-ch01-scene"
    made = json.loads((tmp_path / "frame.json").read_text())
    assert made.keys() == KEYS
    assert all(step.keys() == STEP_KEYS for step in made["steps"])
    outputs = [output for step in made["steps"] for output in step["writes"]]
    assert all(output.keys() == RESOURCE_KEYS | {"file", "mapping"} for output in outputs)
    assert all(one.keys() == RESOURCE_KEYS for step in made["steps"] for one in step["reads"])
    page = (folder / "index.html").read_text()
    assert [step["name"] for step in made["steps"]] == ["forward", "instance_id", "resolve", "tonemap"]
    files = {output["file"] for output in outputs} | {"contact.png", "index.html"}
    assert {path.name for path in folder.iterdir()} == files
    for output in outputs:
        assert read_image(folder / output["file"]).shape == (32, 48, 3)
        assert output["format"] in page and f'src="{output["file"]}"' in page
    # Nothing is linked to that is not there, and nothing lies outside the folder.
    anchors = set(re.findall(r'id="([^"]+)"', page))
    for link in re.findall(r'(?:href|src)="([^"]+)"', page):
        assert link[1:] in anchors if link.startswith("#") else (folder / link).is_file(), link
    assert "http" not in page and "prefers-color-scheme" in page
    reads = {
        step["name"]: [(one["name"], one["written_by"]) for one in step["reads"]] for step in made["steps"]
    }
    assert reads["tonemap"] == [("color_hdr", "resolve")] and reads["resolve"] == [("color_msaa", "forward")]
    ids = read_image(folder / "2-instance_id-instance_id.png").reshape(-1, 3)
    assert np.abs(ids[ids.any(axis=-1)] - 255 * palette.id_color(1)).max() <= 0.5


def test_passes_after_the_one_named_are_left_out(strata, tmp_path):
    scene = triangle().write(tmp_path)
    draw = ("frame", "1", "--scene", scene, "--size", "16x16")
    code, out, _ = strata(*draw, "--after", "forward", "--out", "here", "--view", "overdraw")
    assert code == 0 and "tonemap" not in out
    assert sorted(path.name for path in (tmp_path / "here").iterdir()) == [
        "1-forward-color_hdr.png",
        "1-forward-depth_empty.png",
        "contact.png",
        "index.html",
    ]
    assert (
        "Left out after the last pass shown: instance_id, tonemap"
        in (tmp_path / "here" / "index.html").read_text()
    )
    counts = read_image(tmp_path / "here" / "1-forward-color_hdr.png")
    assert {tuple(row) for row in counts.reshape(-1, 3).tolist()} == {(0, 0, 0), (255, 255, 255)}


@pytest.mark.parametrize("size", [(1, 900), (900, 1), (33, 17)])
def test_the_contact_sheet_of_any_size_is_small(strata, tmp_path, size):
    scene = triangle().write(tmp_path)
    code, _, err = strata("frame", "1", "--scene", scene, "--size", "{}x{}".format(*size), "--out", "here")
    assert code == 0, err
    height, width, _ = read_image(tmp_path / "here" / "contact.png").shape
    assert max(width, height) < 1200
    assert read_image(tmp_path / "here" / "3-tonemap-color.png").shape[:2] == size[::-1]


@pytest.mark.feature("tools/frame")
def test_what_is_wrong_is_said_in_one_sentence(strata, tmp_path):
    scene = triangle().write(tmp_path)
    (tmp_path / "file").write_text("")
    draw = ("frame", "1", "--scene", scene, "--size", "16x16")
    for words, said in (
        (("--after", "forwrd"), "no pass 'forwrd'; did you mean 'forward'?"),
        (("--after", "resolve"), "no pass 'resolve'; known are 'forward', 'instance_id', 'tonemap'."),
        (("--out", "file"), "--out file is a file"),
        (("--out", "file/below"), "nothing can be written to"),
        (("--view", "normals"), "did you mean 'normal'?"),
        (("--json", "nowhere/x.json"), "--json"),
        (("--quality", "hgh"), "did you mean 'high'?"),
    ):
        code, out, err = strata(*draw, *words)
        assert (code, out) == (2, ""), words
        assert said in err and err.count("\n") == 1, err
    assert strata("frame", "99")[0] == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.feature("tools/frame")
@pytest.mark.parametrize("graph", ["deferred", "forward"])
def test_a_frame_of_a_graph_is_shown_as_the_graph_connects_it(strata, tmp_path, vulkan_instance, graph):
    scene = triangle().write(tmp_path)
    draw = ("frame", "4", "--scene", scene, "--size", "16x12", "--set", f"graph={graph}", "--out", "here")
    options = checked(vulkan_instance, "vulkan")
    code, out, err = strata(*draw, "--set", "aperture=2", "--json", "frame.json", *options)
    assert code == 0, err
    made = json.loads((tmp_path / "frame.json").read_text())
    steps = {step["name"]: step for step in made["steps"]}
    assert [*steps][-4:] == ["circle_of_confusion", "bokeh", "depth_of_field", "tonemap"]
    (read,) = steps["tonemap"]["reads"]
    assert (read["name"], read["written_by"], read["format"]) == (
        "color_focused",
        "depth_of_field",
        "rgba16f",
    )
    half = next(one for one in steps["bokeh"]["writes"] if one["name"] == "dof_blurred")
    assert half["size"] == [8, 6] and read_image(tmp_path / "here" / half["file"]).shape == (6, 8, 3)
    assert "depth_prepass" in made["skipped"] and "depth_prepass" in out
    held = {name: one for one in made["resources"] for name in one["names"]}
    assert {one["name"] for step in made["steps"] for one in step["writes"]} <= {*held}
    assert held["dof_half"]["first"] == "circle_of_confusion" and held["dof_half"]["bytes"] == 8 * 6 * 8
    page = (tmp_path / "here" / "index.html").read_text()
    assert made["skipped"]["depth_prepass"] in page and "dof_half" in page
    # Without a lens its passes are left out, and who read them reads what there is.
    code, _, err = strata(*draw, "--without", "all", "--json", "frame.json")
    assert code == 0, err
    made = json.loads((tmp_path / "frame.json").read_text())
    assert {"circle_of_confusion", "bokeh", "depth_of_field"} <= made["skipped"].keys()
    (read,) = made["steps"][-1]["reads"]
    lit = {"deferred": ("color_lit", "lighting"), "forward": ("color_hdr", "forward")}[graph]
    assert (read["name"], read["written_by"]) == lit
