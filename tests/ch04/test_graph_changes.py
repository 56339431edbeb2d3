"""A frame graph that is changed between two frames: switched, inserted, swapped, looked at, and edited in its file."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from backends.contract import Access, Sources
from chapters.ch04.graph import plan
from chapters.ch04.graph.file import graph_path
from chapters.ch04.graph.types import GraphError
from chapters.ch04.pipelines.description import PipelineDescription
from chapters.ch04.post.fullscreen import FullscreenPass
from chapters.ch04.settings import Settings
from common.errors import ShaderError, StaleFrameError
from common.files import shader_files
from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material
from common.settings import replaced
from common.view.camera import Perspective, View, exposure
from tests.support.scenes import quad_scene, translated

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (24, 16)
SUN = Light("directional", node=0, intensity=math.pi)
SOLID = Material(base_color=(0.7, 0.5, 0.3, 1.0), roughness=0.4)
GLASS = Material(base_color=(0.2, 0.6, 0.9, 0.5), alpha_mode="blend")
SETTINGS = Settings(
    default_light=False, ambient=0.3, anisotropy=1.0, aperture=0.02, focus_distance=3.0, tone_curve="none"
)
VIEW = View(pose_looking_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)), Perspective(math.radians(60.0), 0.1))
GRAPHS = ("deferred", "forward")
INVERT = """layout(BIND(0, 0, 3)) uniform sampler2D source;
layout(location = 0) out vec4 out_color;
void main() {
    out_color = vec4(1.0 - clamp(texelFetch(source, ivec2(gl_FragCoord.xy), 0).rgb, 0.0, 1.0), 1.0);
}
"""


@pytest.fixture(scope="module")
def scene():
    return quad_scene(
        matrices=(translated(-0.5, 0, 0), translated(0.2, 0.3, 0.4)),
        materials=(SOLID, GLASS),
        instance_materials=(0, 1),
        lights=(SUN,),
    )


@pytest.fixture
def opened(chapter, scene):
    """Return a function that opens a renderer, which is closed at the end."""
    made = []

    def open_(graph="deferred", **more):
        options = {"outputs": {"color", "color_linear"}, **more}
        turned = options.pop("settings", {})
        made.append(chapter.open(scene, SIZE, replaced(SETTINGS, graph=str(graph), **turned), **options))
        return made[-1]

    yield open_
    for renderer in made:
        renderer.close()


@pytest.fixture
def invert(chapter, tmp_path):
    """Return a class of passes that invert what they read, in light."""
    file = tmp_path / "invert.frag"
    file.write_text(INVERT)

    class Invert(FullscreenPass):
        name = "invert"
        sources = Sources(first={"texture": 3})
        reads = (Access("color_focused", "sampled"),)
        writes = (Access("color_inverted", "color", format="rgba16f"),)

        def describe(self):
            shaders = ("post/fullscreen.vert", str(file))
            return PipelineDescription(shaders=shaders, depth=None, name=self.name, color="rgba16f")

    return Invert


def picture(renderer, name="color"):
    return renderer.render(VIEW).image(name)


def names(renderer):
    return [node.name for node in renderer.nodes]


# --- on and off -------------------------------------------------------------------------------------------------------


@pytest.mark.feature("frame-graph/node-enable")
@pytest.mark.parametrize("graph", GRAPHS)
def test_every_pass_can_be_switched_off_and_on_again_or_says_who_needs_it(opened, graph):
    renderer = opened(graph)
    before, whole = picture(renderer), names(renderer)
    work = renderer.render(VIEW).work
    refused = []
    for name in renderer.switches:
        resources = set(renderer.graph.resources)
        try:
            renderer.switch_pass(name, False)
        except GraphError as error:
            refused.append(name)
            text = str(error)
            assert f"'{name}'" in text and f"{graph}.json:" in text and text.count(".\n") == 0
        else:
            assert renderer.switches[name] is False and name not in names(renderer)
            assert renderer.graph.left_out[name] == "switched off"
            assert set(renderer.graph.resources) <= resources
            frame = renderer.render(VIEW)
            assert frame.work["passes"] == len(frame.timings) == len(names(renderer))
            assert np.array_equal(frame.image("color"), before) == (name not in whole), name
        renderer.switch_pass(name, True)
        assert names(renderer) == whole
        assert np.array_equal(picture(renderer), before), name
    last = renderer.render(VIEW).work
    assert {key: last[key] for key in renderer.graph_work} == {key: work[key] for key in renderer.graph_work}
    needed = {"deferred": {"gbuffer", "lighting"}, "forward": {"forward"}}[graph]
    assert set(refused) == needed | {"circle_of_confusion", "bokeh", "tonemap"}


@pytest.mark.feature("frame-graph/node-enable")
def test_the_buffer_of_an_output_has_the_bytes_of_its_format(opened):
    """8 bits of four channels, half floats of four, a float and an integer for each of the 24 x 16 pixels."""
    outputs = {"color": 4, "color_linear": 8, "depth": 4, "instance_id": 4}
    graph = opened(outputs={*outputs}).graph
    found = {name: graph.resources[plan.on_cpu(name)].bytes for name in outputs}
    assert found == {name: SIZE[0] * SIZE[1] * size for name, size in outputs.items()}


def test_what_only_a_pass_used_goes_with_it_and_its_readers_get_what_it_says(opened):
    renderer = opened()
    assert {"dof_half", "dof_blurred", "color_focused"} <= set(renderer.graph.resources)
    renderer.switch_pass("depth_of_field", False)
    assert not [name for name in renderer.graph.resources if name.startswith("dof") or "focused" in name]
    assert renderer.graph.left_out["bokeh"] == "no pass reads what it writes"
    (tonemap,) = (node for node in renderer.nodes if node.name == "tonemap")
    assert [one.resource for one in tonemap.reads] == ["color_hdr"]
    sharp = picture(renderer)
    assert np.array_equal(sharp, picture(opened(settings={"aperture": 0.0})))


def test_a_change_is_recorded_once_and_counted_in_every_frame(opened):
    renderer = opened()
    work = renderer.graph_work
    assert (
        work["transient_bytes"] < work["transient_bytes_alone"]
        and work["barriers"] >= work["transitions"] > 0
    )
    figures = []
    for switch in (None, None, None, False, None, None, None):
        if switch is not None:
            renderer.switch_pass("depth_of_field", switch)
        work = renderer.render(VIEW).work
        figures.append(work["recorded"])
        assert {key: work[key] for key in renderer.graph.counts()} == renderer.graph.counts()
    assert figures == [1, 1, 0, 1, 1, 0, 0]
    apart = opened(settings={"alias": False}).render(VIEW).work
    assert apart["transient_bytes"] == apart["transient_bytes_alone"]


# --- passes of one's own ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("graph", GRAPHS)
def test_an_inserted_pass_runs_at_its_place_and_goes_without_a_trace(opened, invert, graph):
    renderer = opened(graph)
    before = picture(renderer)
    renderer.insert_pass(renderer.make_pass(invert), {"tonemap": {"color_focused": "color_inverted"}})
    assert names(renderer)[-3:] == ["depth_of_field", "invert", "tonemap"]
    frame = renderer.render(VIEW)
    light = frame.image("color_linear") * np.float32(exposure(VIEW.ev100))
    assert np.abs(frame.image("color").astype(float) - codes(1.0 - np.clip(light, 0.0, 1.0))).max() <= 1.0
    assert list(frame.timings) == names(renderer)
    renderer.remove_pass("invert")
    assert "invert" not in renderer.switches and np.array_equal(picture(renderer), before)


def codes(linear):
    """Return sRGB codes, as IEC 61966-2-1 has them."""
    return 255.0 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


@pytest.mark.feature("frame-graph/pass-registration")
def test_another_implementation_draws_without_another_graph(opened, invert, chapter, monkeypatch):
    renderer = opened()
    before, graph = picture(renderer), renderer.graph
    of_chapter = next(made for made in renderer.passes if made.name == "depth_of_field")
    picture(renderer)
    monkeypatch.setattr(plan, "compile_graph", lambda *_: pytest.fail("nothing is to be compiled"))

    class Other(invert):
        name = "depth_of_field"
        reads, writes = of_chapter.reads, of_chapter.writes

    happened = watch_rendering(monkeypatch, chapter.backend)
    other = renderer.make_pass(Other)
    other.pre_render = lambda commands: happened.append("hook")
    renderer.swap_pass("depth_of_field", other)
    frame = renderer.render(VIEW)
    assert renderer.graph is graph and other in renderer.passes and of_chapter not in renderer.passes
    assert not np.array_equal(frame.image("color"), before)
    assert frame.work["recorded"] == 1 and list(frame.timings) == names(renderer)
    # In front of its pass, outside of any rendering.
    assert happened.count("hook") == 1 and happened[happened.index("hook") - 1] == "end"
    place = happened[: happened.index("hook")].count("begin")
    assert names(renderer)[place] == "depth_of_field"
    renderer.swap_pass("depth_of_field", of_chapter)
    assert np.array_equal(picture(renderer), before)


def watch_rendering(monkeypatch, backend):
    """Return a list of when rendering begins and ends from now on."""
    if backend == "gl":
        from chapters.ch04.graph.execute.gl_targets import Targets as kind

        calls = {"begin": "begin", "end": "end"}
    else:
        from chapters.ch04.frames.vulkan_commands import Commands as kind

        calls = {"begin_rendering": "begin", "end_rendering": "end"}
    happened = []
    for name, short in calls.items():
        real = getattr(kind, name)

        def noted(self, *given, real=real, short=short):
            happened.append(short)
            return real(self, *given)

        monkeypatch.setattr(kind, name, noted)
    return happened


@pytest.mark.feature("frame-graph/pass-registration")
def test_what_does_not_fit_is_refused_in_one_sentence_and_changes_nothing(opened, invert):
    renderer = opened()
    before, graph = picture(renderer), renderer.graph

    class Circle(invert):
        name = "circle"
        reads = (Access("color", "sampled"),)
        writes = (Access("color_turned", "color", format="rgba16f"),)

    class Twice(invert):
        writes = (Access("color_focused", "color", format="rgba16f"),)

    made, circle = renderer.make_pass(invert), renderer.make_pass(Circle)
    for change, says in (
        (lambda: renderer.switch_pass("bokhe", False), "There is no pass 'bokhe'; did you mean 'bokeh'?"),
        (
            lambda: renderer.switch_pass("tonemap", False),
            "deferred.json:12: No pass would write the output 'color': ",
        ),
        (lambda: renderer.remove_pass("tonemap"), "No pass 'tonemap' was inserted"),
        (
            lambda: renderer.insert_pass(made, {"tonmap": {}}),
            "There is no pass 'tonmap'; did you mean 'tonemap'?",
        ),
        (
            lambda: renderer.insert_pass(made, {"tonemap": {"color_hdr": "color_inverted"}}),
            "'tonemap' reads nothing called 'color_hdr'",
        ),
        (lambda: renderer.insert_pass(renderer.make_pass(Twice)), "both write 'color_focused'"),
        (lambda: renderer.insert_pass(circle, {"tonemap": {"color_focused": "color_turned"}}), "wait for"),
        (lambda: renderer.swap_pass("tonemap", made), "'tonemap' has to read color_hdr, not color_focused."),
        (lambda: renderer.swap_pass("nobody", made), "There is no pass 'nobody'"),
        (lambda: renderer.show_resource("dof_hlaf"), "draws 'dof_hlaf'; did you mean 'dof_half'?"),
    ):
        with pytest.raises(GraphError) as caught:
            change()
        assert says in str(caught.value) and "\n" not in str(caught.value), caught.value
        assert renderer.graph is graph
    renderer.insert_pass(made, {"tonemap": {"color_focused": "color_inverted"}})
    with pytest.raises(GraphError, match="There is a pass 'invert' already"):
        renderer.insert_pass(made)
    renderer.remove_pass("invert")
    assert np.array_equal(picture(renderer), before)


def test_a_pass_whose_shader_is_wrong_is_refused_and_the_old_frame_goes_on(opened, invert, tmp_path):
    renderer = opened()
    before = picture(renderer)
    (tmp_path / "invert.frag").write_text("void main() { wrong }")
    with pytest.raises(ShaderError, match=r"invert\.frag"):
        renderer.insert_pass(renderer.make_pass(invert), {"tonemap": {"color_focused": "color_inverted"}})
    assert np.array_equal(picture(renderer), before) and "invert" not in renderer.switches


def test_a_closed_renderer_says_so(opened):
    renderer = opened()
    renderer.close()
    with pytest.raises(StaleFrameError):
        renderer.switch_pass("tonemap", True)


# --- looking at one resource ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("graph", GRAPHS)
def test_a_resource_that_is_looked_at_is_what_its_pass_wrote_and_shares_memory_alone_of_all(opened, graph):
    whole = opened(graph, inspect=True)
    frame = whole.render(VIEW)
    renderer = opened(graph)
    before, shared = picture(renderer), renderer.graph_work["transient_bytes"]
    drawn = {name for step in renderer.graph.steps for name in step.writes}
    for key in whole.inspection.names:
        name = key.partition("/")[2]
        if name not in drawn:  # outputs alone ask for it: ids, and motion from chapter 11 on
            continue
        assert renderer.show_resource(name) == key
        seen = renderer.render(VIEW)
        assert np.array_equal(seen.image(key), frame.image(key)), key
        assert np.array_equal(seen.image("color"), before)
        root = renderer.graph.resources[renderer.graph.names[name]]
        assert root.life == "kept" and root.name not in renderer.graph.memory.places
        others = {one.life for one in renderer.graph.resources.values() if one is not root}
        assert "transient" in others
    assert renderer.show_resource(None) == "" and renderer.graph_work["transient_bytes"] == shared
    assert np.array_equal(picture(renderer), before)


# --- its file ---------------------------------------------------------------------------------------------------------


def written(path, passes, outputs=None):
    """Write a graph; passes are names or whole entries."""
    entries = [{"pass": one} if isinstance(one, str) else one for one in passes]
    path.write_text(json.dumps({"passes": entries, "outputs": outputs or {}}, indent=1))
    return path


FORWARD = ("forward", "tonemap")
DEFERRED = ("gbuffer", "lighting", "transparent", "tonemap")


def test_an_edited_file_is_taken_over_in_place(opened, tmp_path):
    path = written(tmp_path / "own.json", FORWARD)
    renderer = opened(path)
    forward = picture(renderer)
    assert path in renderer.shader_files and names(renderer) == [*FORWARD]
    written(path, DEFERRED)
    with shader_files.refreshed({path}):
        done = renderer.reload_shaders({path})
    assert done.graph and names(renderer) == [*DEFERRED]
    found = picture(renderer)
    assert np.array_equal(found, picture(opened(path)))
    assert np.abs(found.astype(int) - forward).max() <= 2, "both paths give the same picture"
    # The lens twice, the second time on what the first one made.
    lens = ["circle_of_confusion", "bokeh", "depth_of_field"]
    again = {"pass": "depth_of_field", "name": "again"}
    again |= {"reads": {"color_hdr": "color_focused"}, "writes": {"color_focused": "color_twice"}}
    last = {"pass": "tonemap", "reads": {"color_hdr": "color_twice"}}
    written(path, [*DEFERRED[:3], *lens, again, last])
    renderer.reload_shaders({path})
    assert names(renderer)[-3:] == ["depth_of_field", "again", "tonemap"]
    assert np.array_equal(picture(renderer), picture(opened(path)))
    assert not np.array_equal(picture(renderer), found)


def test_a_file_that_is_wrong_changes_nothing(opened, tmp_path):
    path = written(tmp_path / "own.json", DEFERRED)
    renderer = opened(path)
    before, graph = picture(renderer), renderer.graph
    for text, says in (
        ("{", "own.json:1:2: this is no JSON"),
        (json.dumps({"passes": [{"pass": "forwrad"}]}), "there is no such pass; did you mean 'forward'?"),
        (json.dumps({"passes": [{"pass": "forward"}]}), "color"),
    ):
        path.write_text(text)
        with pytest.raises(GraphError) as caught:
            renderer.reload_shaders({path})
        assert says in str(caught.value) and "\n" not in str(caught.value)
        assert renderer.graph is graph and np.array_equal(picture(renderer), before)
    written(path, FORWARD)
    renderer.reload_shaders({path})
    assert names(renderer) == [*FORWARD]


def test_what_a_file_switches_off_can_be_switched_on(opened, tmp_path):
    entries = [{"pass": name} for name in ("gbuffer", "lighting", "tonemap")]
    entries.insert(2, {"pass": "transparent", "enabled": False})
    path = written(tmp_path / "own.json", entries)
    renderer = opened(path)
    assert renderer.switches["transparent"] is False
    assert renderer.graph.left_out["transparent"].startswith("switched off in ")
    without = picture(renderer)
    renderer.switch_pass("transparent", True)
    assert renderer.switches["transparent"] and not np.array_equal(picture(renderer), without)
    renderer.switch_pass("transparent", False)
    assert np.array_equal(picture(renderer), without)


def test_while_files_are_pinned_a_broken_one_opens_the_graph_that_runs(opened, tmp_path):
    path = written(tmp_path / "own.json", FORWARD)
    with shader_files.pinned():
        opened(path)
        path.write_text("{")
        assert names(opened(path)) == [*FORWARD]
    assert graph_path(str(path)) == path
