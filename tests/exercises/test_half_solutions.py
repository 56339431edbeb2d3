"""Solutions that are right at first sight: the checks of exercises have to see what is missing."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import pytest

import chapters
from chapters.folders import Folder
from common.errors import UnsupportedError
from tools.exercises import checking, find
from tools.exercises.patches import states
from tools.snapshots.trees import write_files

pytestmark = pytest.mark.feature("tools/exercises")

WAITED = ("SLOTS]\n        self.wait(slot)",)
VALUES = """SLOTS]
        from ..queues.vulkan_timeline import wait_timelines
        wait_timelines([(one, {}) for one in self.pace.timelines.values()])"""

ROLES = ("scene/textures/texels.py", 'role in ("base_color", "emissive")')
DEFERRED = (
    "scene/textures/vulkan_bindless.py",
    "self._resources.defer(lambda: self._give_back(kind, slot))",
)

NORMAL = ("shading/forward.vert", "transform_vector(instance.normal_from_object, in_normal)")
TONEMAP = (
    "renderer.py",
    "            commands.barrier(self._to_tonemap)\n            self._run(self._tonemap, self._tonemap_rendering)",
)
MIRRORED = ("scene/draw_lists.py", "batch(instances, order[2], order[3])")
OPCODE = ("pipelines/spirv/words.py", "first & 0xFFFF, first >> 16")
POOL = (
    "frames/recording/vulkan_pools.py",
    "self.pools[pool_index(slot.index, self._workers.tasks.thread, self.threads)]",
)
ACQUIRE = ("loading/vulkan_barriers.py", "read, *layouts, families)")
ALIVE = ("graph/memory/placement.py", "(first[:, None] <= last) & (first <= last[:, None])")
WRITES = ("graph/sync/barriers.py", "combined is None or combined.writes")
SLOT = ("frames/recording/vulkan_recordings.py", "        self.wait(slot)\n        slot.number")
BEFORE = ("graph/execute/batches.py", "frame = self._before if wait.before else self._now")
TAKEN = ("cloth/model.py", "        taken[a] |= bit\n        taken[b] |= bit")
CHANGED = ("scene_cache/sources.py", "(current != state or racy)")
SKY = ("shading/lighting.frag", "        sky();\n        return;")
STRETCH = ("culling/tests.glsl", "sphere.w * stretch_bound(world)")
LEVEL = ("culling/pyramid.glsl", "uint level = occlusion_level(first, last);")
SEEN = ("culling/unit.glsl", "        atomicAnd(visible[word], ~mask);\n")
SCAN = ("culling/sums.glsl", "        sums[me] += other;\n        barrier();\n")
GUARD = ("meshlets/select.task", "unit < first_unit(sizes.more.w)")
AXES = ("meshlets/facing.py", 'axes, cutoffs = unpack_cones(records["cone"])')
SMALL = ("culling/draws.comp", "footprint.known && max(pixels.x, pixels.y)")
TILE = ("clusters/walk.glsl", "bits &= light_lists[walk.tile + walk.word];")
OVERLAP = (
    "clusters/bins.comp",
    " && bin_of(interval.x, first_code) <= bin && bin <= bin_of(interval.y, first_code)",
)
MOVED = ("motion/reprojection.glsl", "0.5 * (here - there)")
PLACE = ("taa/resolve.comp", " / vec2(imageSize(resolved)) - moved;")
SHARED = ("taa/weights.glsl", "shared_out(mix(HISTORY_LEAST, HISTORY_MOST, likeness), share);")
FINITE = ("taa/resolve.comp", "!any(isnan(color)) && !any(isinf(color))")
SQUARES = (
    "taa/neighbourhood.glsl",
    "        precise vec3 away = samples[i] - mean;\n        squares += away * away;",
)
SHARE = ("taa/ages.py", "shares[number] if number else 1.0")
ALONG = ("post/fxaa.frag", "ivec2(abs(side.y), abs(side.x))")
AROUND = ("clusters/bounds.comp", "bool around = distance <= radius;")
MARK = ("shading/normal_code.glsl", "0x80008000u")
OCCLUDED = ("shading/lighting.frag", "occlusion *= ambient_factor(visible, OCCLUSION_BIAS, OCCLUSION_SCALE);")
PLACES = ("clusters/which.py", "return [int(light) for light in words[HEADER + places]]")
KEPT = ("hdr/adapt.comp", "vec4(later, now, state, mean)")
LAYERS = ("transparency/sort.glsl", "    uint count = end - begin;\n")
TIES = ("transparency/sort.glsl", "a.y > b.y;\n    }\n    return a.z != b.z ? a.z > b.z : a.w > b.w;")
TURN = ("rates/sobel.glsl", "frame.frame_index) & 7u) == 0u;")
LIT = ("rates/codes.glsl", "min(origin + block / 2, size - 1)")
REPLACES = ("rates/vulkan.py", "vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_REPLACE_KHR")
PROGRAM = ("pipelines/gl_specialization.py", 'f"{source.key} {sorted(values.items())}"')
EDGE = ("rates/picture.py", "~(squared <= threshold)")
NEAR = ("fog/scatter.comp", "    if (p.z <= face.origin.w) {")
HIDDEN = ("fog/scatter.comp", "ivec2(floor(receiver.at)), stored) ? 0.0 : 1.0")
FOUR = ("fog/spatial.comp", "stored(sum / weights)")
COLUMN = ("fog/integrate.comp", "ray_stretch(froxel_uv(froxel), frame.steady_clip_from_view)")
FIRST = ("fog/places.py", "        return part * near * ratio ** (1 / count)")
AHEAD = ("fog/places.py", "np.where(depths > 0.0, depths, near)")
BELOW = ("fog/ways.py", "max(-low, 0.0) / (high - low) if high > low else 0.0")

CASES = {
    "normalised, and still by the matrix of positions": (
        (1, "crooked-normals"),
        (*NORMAL, "normalize(transform_vector(instance.world_from_object, in_normal))"),
        "stretched along x has a normal",
    ),
    "normals as the file has them": (
        (1, "crooked-normals"),
        (*NORMAL, "in_normal"),
        "only turned has a normal",
    ),
    "normals inside out": (
        (1, "crooked-normals"),
        (*NORMAL, "-transform_vector(instance.normal_from_object, in_normal)"),
        "180 degrees off",
    ),
    "a barrier after the pass": (
        (1, "missing-barrier"),
        (
            *TONEMAP,
            "            self._run(self._tonemap, self._tonemap_rendering)\n"
            "            commands.barrier(self._to_tonemap)",
        ),
        "With msaa=1 the layers",
    ),
    "the barrier of another pass": (
        (1, "missing-barrier"),
        (*TONEMAP, TONEMAP[1].replace("self._to_tonemap", "self._to_forward")),
        "With msaa=1 the layers",
    ),
    "a barrier where samples are resolved alone": (
        (1, "missing-barrier"),
        (
            *TONEMAP,
            TONEMAP[1].replace(
                "  commands", "  if self._resolve in self.passes:\n                commands", 1
            ),
        ),
        "With msaa=1 the layers",
    ),
    "all of a batch as its last instance": (
        (1, "half-a-mirror"),
        ("scene/draw_lists.py", "material, bool(mirrored[instance]))", "material, False)"),
        "mirror image is not seen",
    ),
    "the other way round": (
        (1, "half-a-mirror"),
        (*MIRRORED, "batch(instances, order[2], not order[3])"),
        "square is not seen",
    ),
    "mirrored if any is": (
        (1, "half-a-mirror"),
        ("scene/draw_lists.py", "material, bool(mirrored[instance]))", "material, bool(mirrored.any()))"),
        "square is not seen",
    ),
    "twelve bits": ((2, "opcode-in-a-byte"), (*OPCODE, "first & 0xFFF, first >> 16"), "opcode 5341"),
    "ten bits": ((2, "opcode-in-a-byte"), (*OPCODE, "first & 0x3FF, first >> 16"), "opcode 5341"),
    "all bits": ((2, "opcode-in-a-byte"), (*OPCODE, "first, first >> 16"), "opcode 26"),
    "one pool for all threads": (
        (3, "pool-of-another"),
        (*POOL, "self.pools[pool_index(slot.index, 0, self.threads)]"),
        "come from 1 pools",
    ),
    "one family on both sides": (
        (3, "wrong-way-round"),
        (*ACQUIRE, "read, *layouts, (families[0], families[0]))"),
        "says 2 to 2",
    ),
    "the other family on both sides": (
        (3, "wrong-way-round"),
        (*ACQUIRE, "read, *layouts, (families[1], families[1]))"),
        "says 0 to 0",
    ),
    "alive at one end alone": (
        (4, "one-step-short"),
        (*ALIVE, "(first[:, None] <= last) & (first < last[:, None])"),
        "they share bytes",
    ),
    "alive for ever": (
        (4, "one-step-short"),
        (*ALIVE, "np.ones((len(first), len(first)), bool)"),
        "768 are taken",
    ),
    "an epoch for each step": ((4, "no-new-layout"), (*WRITES, "True"), "waits for one of them alone"),
    "the sky and the surface": ((4, "empty-sky"), (*SKY, "        sky();"), "the background is 0"),
    "a background of black": ((4, "empty-sky"), (*SKY, "        return;"), "the background is 0"),
    "the right number for the wrong timelines": (
        (5, "minus-one"),
        (
            *SLOT,
            "        from ..queues.vulkan_timeline import wait_timelines\n"
            "        value = max(self.number - SLOTS + 1, 0)\n"
            "        wait_timelines([(one, value) for one in self.pace.timelines.values()])\n        slot.number",
        ),
        "never begins",
    ),
    "never waits": ((5, "minus-one"), (*SLOT, "        slot.number"), "is written over"),
    "the other end alone": ((5, "few-colours"), (*TAKEN, "        taken[b] |= bit"), "both move particle 0"),
    "the last colour alone": (
        (5, "few-colours"),
        (*TAKEN, "        taken[a] |= bit\n        taken[b] = bit"),
        "both move particle 9",
    ),
    "always the frame before": ((5, "cpu-has-waited"), (*BEFORE, "frame = self._before"), "neither waits"),
    "every texture decoded": ((1, "codes-as-light"), (*ROLES, "True"), "in a texture of another kind"),
    "all but normals decoded": (
        (1, "codes-as-light"),
        (*ROLES, 'role != "normal"'),
        "in a texture of another kind",
    ),
    "emission forgotten": ((1, "codes-as-light"), (*ROLES, 'role == "base_color"'), "that glows"),
    "unsorted": (
        (2, "set-table"),
        (
            "pipelines/spirv/set_table.py",
            "(one.set, one.binding, _name(one))",
            "(one.set, one.kind, _name(one))",
        ),
        "should be",
    ),
    "open though closed": (
        (2, "set-table"),
        ("pipelines/spirv/set_table.py", ".counts[:1] == (0,)", ".counts != ()"),
        'should be "set 0 binding 4: storage Table_, 48 bytes"',
    ),
    "leaked": (
        (2, "reused-slot"),
        (
            "scene/textures/vulkan_bindless.py",
            "self._resources.defer(lambda: self._give_back(kind, slot))",
            "pass",
        ),
        "never given out again",
    ),
    "written too early": (
        (2, "reused-slot"),
        (
            "scene/textures/vulkan_bindless.py",
            "self._resources.defer(lambda: self._give_back(kind, slot))",
            "self._queue[kind, slot] = self._dummy[kind]\n"
            "        self._resources.defer(lambda: self._slots[kind].give_back(slot))",
        ),
        "the next frame writes it",
    ),
    "a pool for each thread, whatever the frame": (
        (3, "pool-of-another"),
        (
            "frames/recording/vulkan_pools.py",
            "pool_index(slot.index, self._workers",
            "pool_index(0, self._workers",
        ),
        "Two frame slots",
    ),
    "hashed every time": (
        (3, "put-back-times"),
        ("scene_cache/sources.py", "(current != state or racy)", "True"),
        "read and hashed all the same",
    ),
    "refused unasked": (
        (3, "put-back-times"),
        (
            "scene_cache/sources.py",
            "        if current.size >= 0 and",
            "        if current != state:\n            return False\n        if current.size >= 0 and",
        ),
        "of another time and the same content",
    ),
    "both the other way round": (
        (3, "wrong-way-round"),
        ("loading/vulkan_barriers.py", "families = (giver, taker)", "families = (taker, giver)"),
        "the release says",
    ),
    "equals by the last": (
        (3, "critical-path"),
        ("tasks/critical_path.py", "max(step.after, key", "max(reversed(step.after), key"),
        "named first",
    ),
    "shared with nobody": (
        (4, "one-step-short"),
        ("graph/memory/placement.py", "return (first[:, None] <= last) &", "return (first[:, None] >= 0) |"),
        "512 bytes do",
    ),
    "black behind everything": (
        (4, "empty-sky"),
        ("shading/lighting.frag", "        sky();", "        out_color = vec4(0.0);"),
        "With background=0.25",
    ),
    "who reads what was written is no writer": (
        (4, "no-new-layout"),
        ("graph/sync/barriers.py", "combined is None or combined.writes", "combined is None or touch.writes"),
        "visible to the first reader",
    ),
    "squared": (
        (4, "natural-vignette"),
        ("post/vignette.frag", "pow(cosine, 4.0)", "pow(cosine, 2.0)"),
        "of the light is left",
    ),
    "darker without an angle": (
        (4, "natural-vignette"),
        ("post/vignette.frag", "frame.orthographic != 0u ? 1.0 : ", ""),
        "parallel rays",
    ),
    "there without being asked for": (
        (4, "natural-vignette"),
        ("post/vignette.py", "settings.post.vignette and ", ""),
        "runs all the same",
    ),
    "by name alone": (
        (4, "fewest-bytes"),
        ("graph/order_bytes.py", "(sum(behind(name).values()), name)", "name"),
        "One branch",
    ),
    "a colour for each spring": (
        (5, "few-colours"),
        ("cloth/model.py", "bit = ~both & (both + 1)", "bit = 1 << len(bits)"),
        "are enough",
    ),
    "in numbers of 64 bits": (
        (5, "few-colours"),
        ("cloth/model.py", "bit = ~both & (both + 1)", "bit = ~both & (both + 1) & (2**64 - 1)"),
        "a star of 100 springs",
    ),
    "for the last one of the other queue": (
        (5, "cpu-has-waited"),
        (
            "graph/execute/batches.py",
            "            values = frame[wait.batch] if frame else {}\n",
            "            other = QUEUES[batch.queue == GRAPHICS]\n"
            "            values = {other: self._last[other]} if frame else {}\n",
        ),
        "the graph does not ask for that",
    ),
    "even where there is none before": (
        (5, "cpu-has-waited"),
        ("graph/execute/batches.py", "frame[wait.batch] if frame else {}", "frame[wait.batch]"),
        "In front of the first frame",
    ),
    "not below 0": (
        (5, "minus-one"),
        ("frames/recording/vulkan_recordings.py", *WAITED, VALUES.format("max(0, self.number - 1)")),
        "a scene without cloth, frame 2 never begins",
    ),
    "nor above what was promised": (
        (5, "minus-one"),
        (
            "frames/recording/vulkan_recordings.py",
            *WAITED,
            VALUES.format("min(one.last, max(0, self.number - 1))"),
        ),
        "the graphics timeline stands at 1, and its slot is free at 2",
    ),
    "for all that was promised": (
        (5, "minus-one"),
        ("frames/recording/vulkan_recordings.py", *WAITED, VALUES.format("one.last")),
        "the CPU waits for more than its slot",
    ),
    "along its line": (
        (5, "capsule"),
        ("cloth/contact.glsl", "vec3(1.0, 0.0, 0.0);  // along", "outward;  // along"),
        "What begins on its axis",
    ),
    "of its first size": (
        (5, "capsule"),
        (
            "cloth/dispatches.py",
            "(collider.radius, collider.half[1], 0.0)) * scale.max()",
            "(collider.radius, collider.half[1], 0.0))",
        ),
        "turned, moved and scaled",
    ),
    "with open ends": (
        (5, "capsule"),
        ("cloth/contact.glsl", "q.y - clamp(q.y, -size.y, size.y)", "0.0"),
        "What begins in its upper end",
    ),
    "in front of the others": (
        (5, "grain"),
        ("post/grain.py", '    queue = "compute"\n', ""),
        "runs on the queue for graphics",
    ),
    "the same in each frame": (
        (5, "grain"),
        ("post/grain.comp", "scrambled(frame.frame_index)", "0u"),
        "Two frames have the same grain",
    ),
    "brighter alone": (
        (5, "grain"),
        ("post/grain.comp", "/ 8388607.5 - 1.0", "/ 16777215.0"),
        "has the mean 0",
    ),
    "the longest column": (
        (6, "first-column"),
        (
            *STRETCH,
            "sphere.w * 1.00001 * max(max(length(transpose(world)[0]), length(transpose(world)[1])), "
            "length(transpose(world)[2]))",
        ),
        "a matrix with a shear",
    ),
    "all scales together": (
        (6, "first-column"),
        (*STRETCH, "sphere.w * (length(world[0].xyz) + length(world[1].xyz) + length(world[2].xyz))"),
        "far too much",
    ),
    "four texels of the level below": (
        (6, "one-tap"),
        (*LEVEL, "uint level = uint(findMSB(max(max(last.x - first.x, last.y - first.y), 2u)));"),
        "something behind is lost",
    ),
    "a level higher than needed": (
        (6, "one-tap"),
        (*LEVEL, "uint level = min(occlusion_level(first, last) + 1u, pyramid_levels(picture));"),
        "hidden things are kept",
    ),
    "in Python alone": (
        (6, "rounded-down"),
        ("culling/pyramid.comp", "(size[above - 1u] + 1u) / 2u", "max(size[above - 1u] / 2u, uvec2(1u))"),
        "and the least depth below it is",
    ),
    "seen once is seen for ever": ((6, "two-frames-ago"), (*SEEN, ""), "is what is hidden written down"),
    "before the write alone": ((6, "half-a-scan"), (*SCAN, "        sums[me] += other;\n"), "The total"),
    "a whole group less": ((6, "next-batch"), (*GUARD, f"{GUARD[1]} - 1u"), "meshlets are tested"),
    "the axis normalised": (
        (6, "facing"),
        (*AXES, f"{AXES[1]}\n    axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-9)"),
        "the bytes of a cone prove nothing",
    ),
    "without the radius": (
        (6, "facing"),
        ("meshlets/facing.py", ' + records["radius"]', ""),
        "the bytes of a cone prove nothing",
    ),
    "not for what is no number": (
        (6, "facing"),
        (
            "meshlets/facing.py",
            '>= cutoffs * distance + records["radius"]',
            '- cutoffs * distance - records["radius"]\n    away = ~(away < 0)',
        ),
        "may face any eye",
    ),
    "the shorter side": ((6, "tiny"), (*SMALL, "footprint.known && min(pixels.x, pixels.y)"), "is not drawn"),
    "the first word alone": (
        (7, "next-word"),
        (*TILE, "bits &= walk.word == 0u ? light_lists[walk.tile] : ~0u;"),
        "is evaluated twice there",
    ),
    "the first of each word for all": (
        (7, "next-word"),
        (*TILE, "bits &= light_lists[walk.tile + walk.word] | 1u;"),
        "which cannot reach its tile",
    ),
    "always two words": (
        (7, "next-word"),
        ("clusters/walk.glsl", "LIST_TILES_X] + tile.x) * words;", "LIST_TILES_X] + tile.x) * 2u;"),
        "With 32 lamps",
    ),
    "all but the last bin": (
        (7, "hit-the-middle"),
        (*OVERLAP, OVERLAP[1].replace("bin <= bin_of(interval.y", "bin < bin_of(interval.y")),
        "and has no bit in bin",
    ),
    "in every bin": ((7, "hit-the-middle"), (*OVERLAP, ""), "and has a bit in bin"),
    "from the first lamp of its word": (
        (7, "hit-the-middle"),
        ("clusters/bins.comp", "low = min(low, place + 1u);", "low = min(low, first + 1u);"),
        "of the order, and says",
    ),
    "at the eye alone": ((7, "behind-you"), (*AROUND, "bool around = distance < 1e-3;"), "and has no bit in"),
    "around the eye, wherever they are": (
        (7, "behind-you"),
        (*AROUND, "bool around = true;"),
        "and cannot reach",
    ),
    "all bits set": ((7, "black-wall"), (*MARK, "0xFFFFFFFFu"), "is a code, too"),
    "the largest of both": ((7, "black-wall"), (*MARK, "0x7FFF7FFFu"), "A wall that faces -z"),
    "lamps as well": (
        (7, "dark-lamps"),
        ("shading/lighting.frag", "color += received *", "color += received * occlusion *"),
        "is left of all light",
    ),
    "in place of the material's own": (
        (7, "dark-lamps"),
        (*OCCLUDED, OCCLUDED[1].replace("*=", "=")),
        "the light without occlusion is",
    ),
    "without the bias": (
        (7, "dark-lamps"),
        (*OCCLUDED, OCCLUDED[1].replace("OCCLUSION_BIAS", "0.0")),
        "should give",
    ),
    "places for lights": (
        (7, "whose-light"),
        (*PLACES, "return [int(place) for place in places]"),
        "is missing",
    ),
    "by number": (
        (7, "whose-light"),
        (*PLACES, "return sorted(int(light) for light in words[HEADER + places])"),
        "not in the order",
    ),
    "of the tile alone": (
        (7, "whose-light"),
        ("clusters/which.py", "_bits(words, layout.first_depth, depth_bin, layout) & ", ""),
        "is too much",
    ),
    "an array of 64": (
        (7, "sixteen-of-forty"),
        (*LAYERS, f"    end = min(end, begin + 64u);\n{LAYERS[1]}"),
        "as of 64.0",
    ),
    "longer lists as they come": (
        (7, "sixteen-of-forty"),
        (
            *LAYERS,
            "    for (; begin + SHORT < end; ++begin) { under = over(keys[begin].w, under); }\n" + LAYERS[1],
        ),
        "layers of different colours",
    ),
    "equal depths as before": (
        (7, "from-the-front"),
        (*TIES, TIES[1].replace(">", "<")),
        "of equal depths",
    ),
    "at the limit, not below it": (
        (7, "from-the-front"),
        ("transparency/sort.glsl", "count > 0u && through >= FAINT", "count > 0u && through > FAINT"),
        "exactly 1/1024",
    ),
    "at the limit in short lists": (
        (7, "from-the-front"),
        ("transparency/sort.glsl", "done < count && through >= FAINT", "done < count && through > FAINT"),
        "exactly 1/1024",
    ),
    "short lists alone end early": (
        (7, "from-the-front"),
        ("transparency/sort.glsl", "count > 0u && through >= FAINT", "count > 0u"),
        "is composited to its end",
    ),
    "the light behind short lists forgotten": (
        (7, "from-the-front"),
        (
            "transparency/sort.glsl",
            "return seen + through * under;\n    }",
            "return seen;\n    }",
        ),
        "the light behind it",
    ),
    "its logarithm in half precision": (
        (7, "half-adaptation"),
        (
            *KEPT,
            "vec4(later, now, MODE_MIPS == 1 ? exp2(unpackHalf2x16(packHalf2x16(vec2(log2(state)))).x) : state, mean)",
        ),
        "has come to rest",
    ),
    "with the histogram alone": (
        (7, "half-adaptation"),
        (
            *KEPT,
            "vec4(later, now, MODE_MIPS == 1 ? unpackHalf2x16(packHalf2x16(vec2(state))).x : state, mean)",
        ),
        "With exposure=mips",
    ),
    "at once where it would stand still": (
        (7, "half-adaptation"),
        (*KEPT, "vec4(later, now, abs(state - target) < 0.3 ? target : state, mean)"),
        "on its way",
    ),
    "by the peak": (
        (1, "reinhard"),
        (
            "post/tonemap.frag",
            "color / (1.0 + color)",
            "color / (1.0 + max(color.r, max(color.g, color.b)))",
        ),
        "each channel",
    ),
    "instead of another curve": (
        (1, "reinhard"),
        ("post/tonemap.frag", "color = tone_neutral(color);", "color = color / (1.0 + color);"),
        "is not what it was",
    ),
    "without an orthographic camera": (
        (1, "facing-view"),
        ("shading/views.glsl", "frame.orthographic != 0u ? frame.world_from_view[2].xyz : to_eye", "to_eye"),
        "leans by",
    ),
    "without an eye": (
        (1, "facing-view"),
        (
            "shading/views.glsl",
            "frame.orthographic != 0u ? frame.world_from_view[2].xyz : to_eye",
            "frame.world_from_view[2].xyz",
        ),
        "before an eye",
    ),
    "greater than the threshold": (
        (9, "mask-of-a-picture"),
        (*EDGE, "squared > threshold"),
        "a pixel that is no number",
    ),
    "Sobel alone": (
        (9, "mask-of-a-picture"),
        ("rates/picture.py", "[across**2 + down**2, right**2, below**2]", "[across**2 + down**2]"),
        "stripes of one pixel",
    ),
    "a step for two frames": (
        (9, "sleeping-squares"),
        (*TURN, "(frame.frame_index >> 1)) & 7u) == 0u;"),
        "squares are lit by blocks in each of 8 frames",
    ),
    "always": (
        (9, "sleeping-squares"),
        (*TURN, "frame.frame_index) & 0u) == 0u;"),
        "In 8 of 8 frames",
    ),
    "not within the picture": (
        (9, "corner-of-a-block"),
        (*LIT, "origin + block / 2"),
        "over the edge of the picture",
    ),
    "half of what is left": (
        (9, "corner-of-a-block"),
        (*LIT, "min(origin + (block - 1) / 2, size - 1)"),
        "inside of the picture",
    ),
    "both keep": (
        (9, "nothing-happens"),
        (*REPLACES, "vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_KEEP_KHR"),
        "a fragment covers 1x1 pixels",
    ),
    "the finer one": (
        (9, "nothing-happens"),
        (*REPLACES, "vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_MIN_KHR"),
        "a fragment covers 1x1 pixels",
    ),
    "values without ids": (
        (9, "one-program-for-two"),
        (*PROGRAM, 'f"{source.key} {sorted(values.values())}"'),
        "has the key of the same shader with",
    ),
    "ids and values without the text": (
        (9, "one-program-for-two"),
        (*PROGRAM, 'f"{source.stage} {sorted(values.items())}"'),
        "different texts have one key",
    ),
    "light that is seen by halves": (
        (10, "light-through-walls"),
        (*HIDDEN, "ivec2(floor(receiver.at)), stored) ? 0.0 : 0.5"),
        "another light than without shadows",
    ),
    "extinction alone": (
        (10, "fog-that-does-not-dim"),
        (*FOUR, "stored(vec4(texelFetch(fog_light, froxel, 0).rgb, sum.a / weights))"),
        "froxels light is not the mean",
    ),
    "the stretch of the middle": (
        (10, "clear-corners"),
        (*COLUMN, "ray_stretch(vec2(0.5), frame.steady_clip_from_view)"),
        "away along the ray",
    ),
    "the first slice by ratio": (
        (10, "froxel-of-a-point"),
        (*FIRST, "        return near * ratio ** (part / count)"),
        "the sample of slice 0",
    ),
    "all above the base": ((10, "way-through-layers"), (*BELOW, "0.0"), "upwards through the base"),
    "a quarter of the difference": (
        (11, "twice-as-far"),
        (*MOVED, "0.25 * (here - there)"),
        "and the vector is",
    ),
    "a history of nowhere": (
        (11, "the-other-way"),
        (*PLACE, " / vec2(imageSize(resolved));"),
        "another colour than without a history",
    ),
    "the weights in their order": (
        (11, "never-quiet"),
        (*SHARED, "vec2(1.0 - likeness, likeness);"),
        "the history's weight is",
    ),
    "infinities alone": (
        (11, "never-gone"),
        (*FINITE, "!any(isinf(color))"),
        "after a pixel was not a number",
    ),
    "an absolute value": (
        (11, "lost-digits"),
        (*SQUARES, "        squares += samples[i] * samples[i] - mean * mean;"),
        "have a deviation of",
    ),
    "the first share as it is": ((11, "weights-of-frames"), (*SHARE, "shares[number]"), "a single frame"),
    "always across": ((11, "across-the-edge"), (*ALONG, "ivec2(1, 0)"), "nearly upright"),
    "black alone": (
        (11, "black-into-nothing"),
        (
            "post/sharpen.frag",
            "sharpening(luminance(color.rgb), sum / 9.0, AMOUNT)",
            "(1.0 + AMOUNT * (1.0 - sum / (9.0 * max(luminance(color.rgb), 1e-6))))",
        ),
        "sharpened as they should be",
    ),
}


RIGHT = {
    "the other textures named": (
        (1, "codes-as-light"),
        (*ROLES, 'role not in ("metallic_roughness", "normal", "occlusion")'),
    ),
    "by the end of the name": ((1, "codes-as-light"), (*ROLES, 'role.endswith(("color", "emissive"))')),
    "waited for": (
        (2, "reused-slot"),
        (*DEFERRED, "self._device.wait_idle()\n        self._give_back(kind, slot)"),
    ),
    "normalised": (
        (1, "crooked-normals"),
        (*NORMAL, "normalize(transform_vector(instance.normal_from_object, in_normal))"),
    ),
    "twice as long": (
        (1, "crooked-normals"),
        (*NORMAL, "transform_vector(instance.normal_from_object, 2.0 * in_normal)"),
    ),
    "before the question": (
        (1, "missing-barrier"),
        (
            "renderer.py",
            f"        if self._tonemap in self.passes:\n{TONEMAP[1]}",
            "        commands.barrier(self._to_tonemap)\n        if self._tonemap in self.passes:\n"
            "            self._run(self._tonemap, self._tonemap_rendering)",
        ),
    ),
    "its first instance": (
        (1, "half-a-mirror"),
        (*MIRRORED, "batch(instances, order[2], bool(mirrored[instances[0]]))"),
    ),
    "all of its instances": (
        (1, "half-a-mirror"),
        (*MIRRORED, "batch(instances, order[2], all(bool(mirrored[i]) for i in instances))"),
    ),
    "the rest of a division": ((2, "opcode-in-a-byte"), (*OPCODE, "first % 65536, first // 65536")),
    "without a shift": (
        (2, "opcode-in-a-byte"),
        (*OPCODE, "first & 65535, (first - (first & 65535)) // 65536"),
    ),
    "the thread asked for first": (
        (3, "pool-of-another"),
        (
            *POOL,
            "(lambda thread: self.pools[pool_index(slot.index, thread, self.threads)])(self._workers.tasks.thread)",
        ),
    ),
    "families by number": ((3, "wrong-way-round"), (*ACQUIRE, "read, *layouts, (families[0], families[1]))")),
    "not equal": ((3, "put-back-times"), (*CHANGED, "(not current == state or racy)")),
    "neither before nor after": (
        (4, "one-step-short"),
        (*ALIVE, "~((last[:, None] < first) | (last < first[:, None]))"),
    ),
    "the common part": (
        (4, "one-step-short"),
        (*ALIVE, "np.maximum(first[:, None], first) <= np.minimum(last[:, None], last)"),
    ),
    "both questions in another order": (
        (4, "no-new-layout"),
        (*WRITES, "not (combined is not None and not combined.writes)"),
    ),
    "else": ((4, "empty-sky"), (*SKY, "        { sky(); return; }")),
    "from the first frame that waits": (
        (5, "minus-one"),
        (*SLOT, "        if self.number >= SLOTS:\n            self.wait(slot)\n        slot.number"),
    ),
    "by its number": (
        (5, "minus-one"),
        (*SLOT, "        self.wait(self.slots[self.number % SLOTS])\n        slot.number"),
    ),
    "in a loop": ((5, "few-colours"), (*TAKEN, "        for end in (a, b):\n            taken[end] |= bit")),
    "as a sum of both": (
        (5, "few-colours"),
        (*TAKEN, "        taken[b] |= bit\n        taken[a] = taken[a] | bit"),
    ),
    "one after the other": (
        (5, "cpu-has-waited"),
        (*BEFORE, "frame = self._now\n            if wait.before:\n                frame = self._before"),
    ),
    "the length of all three columns": (
        (6, "first-column"),
        (
            *STRETCH,
            "sphere.w * 1.00001 * sqrt(dot(world[0].xyz, world[0].xyz) + dot(world[1].xyz, world[1].xyz) + "
            "dot(world[2].xyz, world[2].xyz))",
        ),
    ),
    "the level by trying": (
        (6, "one-tap"),
        (
            *LEVEL,
            "uint level = 1u;\n    while (any(greaterThan((last >> level) - (first >> level), uvec2(1u)))) { "
            "++level; }",
        ),
    ),
    "set and cleared by a choice": (
        (6, "two-frames-ago"),
        (
            "culling/unit.glsl",
            "bool drawn_early =",
            "if (PHASE == 1) { atomicAnd(visible[word], ~mask); }\n    bool drawn_early =",
        ),
    ),
    "by the units that are left": (
        (6, "next-batch"),
        (*GUARD, "unit - first_unit(sizes.more.y) < first_unit(sizes.more.w) - first_unit(sizes.more.y)"),
    ),
    "before the addition": (
        (7, "next-word"),
        (
            "clusters/walk.glsl",
            "LIST_TILES_X] + tile.x) * words;",
            "LIST_TILES_X] * words + tile.x * words);",
        ),
    ),
    "neither before nor behind": (
        (7, "hit-the-middle"),
        (*OVERLAP, " && !(bin < bin_of(interval.x, first_code) || bin > bin_of(interval.y, first_code))"),
    ),
    "half of all directions, towards nothing": (
        (7, "behind-you"),
        ("clusters/bounds.comp", "vec2(-8.0, 8.0)", "vec2(0.0, 1.0)"),
    ),
    "in one half": ((7, "black-wall"), (*MARK, "0x00008000u")),
    "the other factor first": (
        (7, "dark-lamps"),
        (*OCCLUDED, "occlusion = ambient_factor(visible, OCCLUSION_BIAS, OCCLUSION_SCALE) * occlusion;"),
    ),
    "one by one": ((7, "whose-light"), (*PLACES, "return [int(words[HEADER + place]) for place in places]")),
    "the heap for every list": (
        (7, "sixteen-of-forty"),
        ("transparency/sort.glsl", "if (count <= SHORT)", "if (count <= 1u)"),
    ),
    "bit by bit": (
        (7, "half-adaptation"),
        (*KEPT, "vec4(later, now, uintBitsToFloat(floatBitsToUint(state)), 0.0)"),
    ),
    "deferred by another call": (
        (2, "reused-slot"),
        (*DEFERRED, "self._resources.defer(lambda kind=kind, slot=slot: self._give_back(kind, slot))"),
    ),
    "not above": ((9, "mask-of-a-picture"), (*EDGE, "np.logical_not(squared <= threshold)")),
    "by a remainder": ((9, "sleeping-squares"), (*TURN, "frame.frame_index) % 8u) == 0u;")),
    "by a shift": ((9, "corner-of-a-block"), (*LIT, "min(origin + (block >> 1), size - 1)")),
    "the coarser one": (
        (9, "nothing-happens"),
        (*REPLACES, "vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_MAX_KHR"),
    ),
    "the text itself": ((9, "one-program-for-two"), (*PROGRAM, "(source.key + text)")),
    "not behind": ((10, "light-through-walls"), (*NEAR, "    if (!(p.z > face.origin.w)) {")),
    "times the inverse": ((10, "fog-that-does-not-dim"), (*FOUR, "stored(sum * (1.0 / weights))")),
    "the place written out": (
        (10, "clear-corners"),
        (*COLUMN, "ray_stretch((vec2(froxel.xy) + 0.5) / vec2(fog.size.xy), frame.steady_clip_from_view)"),
    ),
    "a small depth for none": ((10, "froxel-of-a-point"), (*AHEAD, "np.maximum(depths, 1e-300)")),
    "each by its half": ((11, "twice-as-far"), (*MOVED, "0.5 * here - 0.5 * there")),
    "from the place of the next": (
        (11, "the-other-way"),
        (*PLACE, " / vec2(imageSize(resolved)) + (-moved);"),
    ),
    "neither of both": ((11, "never-gone"), (*FINITE, "!(any(isnan(color)) || any(isinf(color)))")),
    "the mean by a product": (
        (11, "lost-digits"),
        (*SQUARES, "        squares += (samples[i] - mean) * (samples[i] - mean);"),
    ),
    "turned by a right angle": ((11, "across-the-edge"), (*ALONG, "abs(side.yx)")),
}
"""Solutions that differ from the one of the exercise, and are right."""


def _sample(cases, key):
    """Every case, of which the usual run has the first of each `key(chapter, name)`, and the newest chapter's."""
    seen, found = set(), []
    for name, (exercise, *_) in cases.items():
        rare = key(*exercise) in seen and exercise[0] != chapters.available()[-1]
        seen.add(key(*exercise))
        found.append(pytest.param(name, marks=[pytest.mark.long] * rare))
    return found


@pytest.mark.parametrize("case", _sample(RIGHT, lambda chapter, name: chapter))
def test_another_right_solution_is_accepted(case, tmp_path, request):
    which, change = RIGHT[case]
    assert _judged(which, change, tmp_path, request) is None


@pytest.mark.parametrize("case", _sample(CASES, lambda chapter, name: (chapter, name)))
def test_a_half_solution_is_not_enough(case, tmp_path, request):
    which, change, said = CASES[case]
    wrong = _judged(which, change, tmp_path, request)
    assert wrong is not None and said in wrong


def _judged(which, change, folder, request):
    """Return what the check says to the solution with a change, None if it is right."""
    path, old, new = change
    exercise = find(*which)
    tree = dict(states(exercise).solution)
    text = tree[path].decode()
    assert text.count(old) == 1
    write_files(folder, {**tree, path: text.replace(old, new).encode()})
    backend = exercise.backends[0] if exercise.backends else ""
    held = request.getfixturevalue("vulkan_device") if backend else None
    checked = replace(exercise, backends=(backend,) if backend else ())
    try:
        wrong = checking.check(checked, Folder(folder.resolve()), lambda backend: nullcontext(held))
    except UnsupportedError as error:
        pytest.skip(str(error))
    checking.complaints(held)  # of what is wrong on purpose
    return wrong
