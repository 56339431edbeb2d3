"""Figures of chapter 2: descriptor sets against one set for all, the pointers of a draw, layouts from shaders."""

from __future__ import annotations

from .canvas import Canvas


def sets_or_bindless() -> Canvas:
    """A set for each material that is bound between draws, against one set whose slots are numbers."""
    c = Canvas(760, 330, "A descriptor set for each material, and one set for all textures")
    textures = ("wood", "brick", "glass")
    c.text(12, 26, "a set for each material", bold=True)
    for i, name in enumerate(textures):
        y = 46 + 84 * i
        c.box(12, y, 92, 26, f"bind set {i}", "f")
        c.box(12, y + 32, 92, 26, f"draw {i}")
        c.box(150, y, 92, 58, f"set {i}", "a")
        c.box(284, y + 14, 70, 30, name, "c")
        c.arrow(104, y + 13, 150, y + 20)
        c.arrow(242, y + 29, 284, y + 29)
    c.note(12, 312, "three calls to bind, and three to draw")
    c.text(410, 26, "one set for all textures", bold=True)
    c.box(410, 46, 112, 26, "bind the set", "f")
    c.box(410, 78, 112, 26, "draw all")
    for i in range(3):
        c.box(410, 136 + 44 * i, 112, 34, f"draw {i}: number {(2, 0, 5)[i]}", size=12)
    slots = {0: "brick", 2: "wood", 5: "glass"}
    for slot in range(7):
        y = 60 + 30 * slot
        c.box(590, y, 34, 30, str(slot), "a", round=0)
        if slot in slots:
            c.box(664, y + 2, 70, 26, slots[slot], "c")
            c.arrow(624, y + 15, 664, y + 15)
    for i, slot in enumerate((2, 0, 5)):
        c.arrow(522, 153 + 44 * i, 590, 75 + 30 * slot, "mark")
    c.note(410, 312, "one call of each; a number picks the slot")
    return c


def pointers_of_a_draw() -> Canvas:
    """The buffers that a draw reads: each record has the place of the next one."""
    c = Canvas(760, 300, "The records that a draw follows, from its number to its texels")
    c.box(12, 40, 130, 56, "indirect command\nfirst_instance = 7", "f", 12)
    c.box(206, 40, 130, 94, "draw 7\nobject = 3\nfirst word\nof its vertices", "a", 12)
    c.box(400, 40, 130, 76, "object 3\nworld_from_object\nmaterial = 2", "b", 12)
    c.box(600, 40, 146, 76, "material 2\nfactors\ntexture = 5", "d", 12)
    c.box(600, 176, 146, 56, "slot 5 of the set\nimage and sampler", "c", 12)
    c.box(206, 176, 290, 36, "page of words: positions, normals, uv ...", "e", 12)
    c.arrow(142, 68, 206, 68)
    c.arrow(336, 62, 400, 62)
    c.arrow(530, 78, 600, 78)
    c.arrow(673, 116, 673, 176)
    c.arrow(271, 134, 271, 176)
    for x, words in ((12, "CPU or GPU writes it"), (206, "draws"), (400, "objects"), (600, "materials")):
        c.note(x, 28, words)
    c.note(206, 232, "the vertex shader reads its words by VERTEX_ID")
    c.text(12, 282, "Every arrow is a number in a buffer: nothing is bound between two draws.", 13)
    return c


def layouts_from_shaders() -> Canvas:
    """From the text of two shaders over the words of SPIR-V to one layout for their pipeline."""
    c = Canvas(760, 300, "How a pipeline layout follows from the declarations of its shaders")
    c.text(12, 26, "GLSL", bold=True)
    c.box(12, 40, 216, 64, "forward.vert\nset 0, binding 0: objects\nset 0, binding 1: draws", "a", 12)
    c.box(12, 130, 216, 64, "forward.frag\nset 0, binding 0: objects\nset 1, binding 0: textures[]", "b", 12)
    c.text(268, 26, "words of SPIR-V", bold=True)
    for i, words in enumerate(
        ("OpDecorate %12 Binding 0", "OpDecorate %12 DescriptorSet 0", "OpVariable %12 StorageBuffer")
    ):
        c.box(268, 40 + 52 * i, 226, 40, words, "card", 12, round=0)
    c.arrow(228, 72, 268, 60)
    c.arrow(228, 160, 268, 164)
    c.text(536, 26, "layout of the pipeline", bold=True)
    c.box(536, 40, 212, 40, "set 0, binding 0: vertex, fragment", "c", 11)
    c.box(536, 84, 212, 40, "set 0, binding 1: vertex", "a", 11)
    c.box(536, 128, 212, 40, "set 1, binding 0: fragment", "b", 11)
    c.arrow(494, 112, 536, 104)
    c.box(536, 204, 212, 40, "pipeline, and its cache on disk", "f", 12)
    c.arrow(642, 168, 642, 204)
    c.text(
        12,
        270,
        "The stages of a binding are those that declare it. If two stages declare it in two ways,",
        12,
        role="soft",
    )
    c.note(12, 286, "building the pipeline fails with both files and lines.")
    return c


FIGURES = {
    "ch02-sets-or-bindless": sets_or_bindless,
    "ch02-pointers-of-a-draw": pointers_of_a_draw,
    "ch02-layouts-from-shaders": layouts_from_shaders,
}
