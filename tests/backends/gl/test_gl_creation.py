"""Creation descriptors on OpenGL: what it is asked for, call by call, and what of a description it does not have."""

from __future__ import annotations

import pytest

from backends.creation import BufferCreation, ImageCreation, SamplerCreation
from backends.gl.creation import buffer_from, image_from, sampler_from
from backends.gl.resources import (
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from common.errors import UnsupportedError, UserError
from common.scene import Sampler
from tests.support.creations import BUFFERS, IMAGES, ONE_FIELD, SAMPLERS, ways
from tests.support.raw_calls import gl_calls

creation = pytest.mark.feature("device/creation-descriptors")
MAKERS = {BufferCreation: buffer_from, ImageCreation: image_from, SamplerCreation: sampler_from}
FREE = {
    BufferCreation: destroy_buffer,
    ImageCreation: destroy_image,
    SamplerCreation: lambda context, made: context.destroy("sampler", made),
}
NOT_HERE = ("uses", "place", "families")
"""The fields that are no argument of the keyword functions on OpenGL."""


def calls(context, kind, make, *arguments, **keywords):
    """Return the calls by which a resource is made, and free it."""
    made = []
    log = gl_calls(context, lambda: made.append(make(context, *arguments, **keywords)))
    FREE[kind](context, made[0])
    return log


@creation
@pytest.mark.parametrize("case", BUFFERS)
def test_a_buffer_is_that_of_the_keyword_function(gl_context, case):
    values = BUFFERS[case]
    wanted = (values.get("size", 0), values.get("memory", "device"), values.get("name", ""))
    truth = calls(gl_context, BufferCreation, create_buffer, *wanted)
    assert truth[0][0] == "glCreateBuffers" and "glNamedBufferStorage" in dict(truth)
    for described in ways(BufferCreation, values):
        assert calls(gl_context, BufferCreation, buffer_from, described) == truth


@creation
@pytest.mark.parametrize("case", IMAGES)
def test_an_image_is_that_of_the_keyword_function(gl_context, case):
    values = {name: value for name, value in IMAGES[case].items() if name not in NOT_HERE}
    places = (values.pop("format", "rgba8"), values.pop("size"), values.pop("name"))
    truth = calls(gl_context, ImageCreation, create_image, *places, **values)
    assert truth[0][0] == "glCreateTextures"
    for described in ways(ImageCreation, IMAGES[case]):
        assert calls(gl_context, ImageCreation, image_from, described) == truth


@creation
@pytest.mark.parametrize("case", SAMPLERS)
def test_a_sampler_is_that_of_the_keyword_function(gl_context, case):
    values = dict(SAMPLERS[case])
    name, anisotropy = values.pop("name"), values.pop("anisotropy", 1.0)
    truth = calls(gl_context, SamplerCreation, create_sampler, Sampler(**values), anisotropy, name)
    assert truth[0][0] == "glCreateSamplers"
    for described in ways(SamplerCreation, SAMPLERS[case]):
        assert calls(gl_context, SamplerCreation, sampler_from, described) == truth


@creation
@pytest.mark.parametrize(
    ("kind", "field"), [(kind, field) for kind, table in ONE_FIELD.items() for field in table]
)
def test_each_field_reaches_opengl_but_uses(gl_context, kind, field):
    around, other = ONE_FIELD[kind][field]
    plain = calls(gl_context, kind, MAKERS[kind], kind(**around))
    if field == "anisotropy" and not gl_context.has("anisotropy"):
        pytest.skip("the driver has no anisotropic filters")
    changed = calls(gl_context, kind, MAKERS[kind], kind(**around | {field: other}))
    assert (changed == plain) == (field == "uses")


@creation
@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (BufferCreation, "place", ("memory", 0)),
        (BufferCreation, "families", (0, 1)),
        (ImageCreation, "place", ("memory", 0)),
    ],
)
def test_what_is_vulkans_alone_is_refused(gl_context, kind, field, value):
    """And nothing is made: a resource left behind would fail the module."""
    with pytest.raises(UnsupportedError) as raised:
        MAKERS[kind](gl_context, kind(name="b", **{field: value}))
    assert f"{kind.__name__} 'b': {field}={value!r}: OpenGL has no such thing; leave it" in str(raised.value)


@creation
def test_wrong_fields_are_refused_before_anything_is_made(gl_context):
    def make():
        with pytest.raises(UserError, match="did you mean 'rgba8'"):
            image_from(gl_context, ImageCreation(format="rgba9"))
        with pytest.raises(UserError, match="layers=3: a '2d' image has one"):
            image_from(gl_context, ImageCreation(layers=3))

    assert gl_calls(gl_context, make) == []
