"""A context without block compression stores texels. It is the only one: some drivers end all with the first closed."""

from __future__ import annotations

import numpy as np
import pytest

from backends.gl.context import Context
from backends.gl.resources import create_image
from common.errors import UnsupportedError
from common.images.blocks import PLAIN, storage_of
from common.images.mips import mip_chain
from tests.backends.gl.test_gl_block_textures import sampled
from tests.support.block_pictures import pictures


@pytest.mark.feature("textures/block-compression")
@pytest.mark.feature("textures/etc2-ktx")
@pytest.mark.usefixtures("gl_context")  # which skips it where there is no OpenGL
def test_a_context_without_the_feature_stores_8_bits_a_channel():
    pixels = pictures(16, 8)["alpha"]
    chain = [level.reshape(len(level), -1) for level in mip_chain(pixels, True)]
    with Context(validate=True, without={"block-compression", "etc2"}) as context:
        for wanted, plain in PLAIN.items():
            assert storage_of(wanted, context.features) == plain
            feature = "etc2" if "etc2" in wanted else "block-compression"
            with pytest.raises(UnsupportedError, match=f"'t' cannot be stored as {wanted}.* lacks {feature}"):
                create_image(context, wanted, (16, 8), "t")
        found = sampled(context, storage_of("bc7", context.features), (16, 8), [chain])
    assert np.array_equal(np.rint(found[0][0] * 255), pixels)
