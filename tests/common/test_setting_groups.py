"""Settings nested by subject: code reads `settings.cloth.substeps`, everything outside says `cloth_substeps`."""

from __future__ import annotations

import copy
import json
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import pytest

from common.errors import SettingError
from common.settings import (
    AtMost,
    Grouped,
    apply_overrides,
    describe,
    flat,
    group,
    knob,
    knobs,
    preset,
    replaced,
    set_live,
)


@dataclass
class ShadingSettings:
    msaa: int = knob(1, "samples", choices=(1, 2, 4))
    sky: bool = knob(True, "whether it is seen")


@dataclass
class LoadingSettings:
    mode: str = knob("auto", "whether frames wait", choices=("auto", "wait"), flat="loading")
    threads: int = knob(0, "that decode", minimum=0, maximum=64, flat="decoding_threads")


@dataclass
class ClothSettings:
    enabled: bool = knob(True, "whether it moves", flat="cloth")
    substeps: int = knob(16, "parts of a step", minimum=1, maximum=64, reference=64, flat="cloth_substeps")
    wind_speed: float = knob(0.0, "of the wind", unit="m/s", minimum=0, maximum=60, live=True)


@dataclass(init=False)
class Settings(Grouped):
    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "medium": {},
        "high": {"msaa": AtMost(4), "loading": "wait"},
        "reference": {"sky": False},
    }
    ORDER: ClassVar[str] = "msaa loading sky"

    shading: ShadingSettings = group(ShadingSettings)
    loading: LoadingSettings = group(LoadingSettings)
    cloth: ClothSettings = group(ClothSettings)


NAMES = ["msaa", "loading", "sky", "decoding_threads", "cloth", "cloth_substeps", "wind_speed"]
VALUES = [1, "auto", True, 0, True, 16, 0.0]


def test_flat_names_reach_the_values_of_groups():
    settings = Settings(msaa=4, cloth_substeps=8, loading="wait", cloth=False)
    assert (settings.shading.msaa, settings.cloth.substeps, settings.loading.mode) == (4, 8, "wait")
    assert settings.cloth.enabled is False and settings.loading.threads == 0
    assert settings != Settings() and Settings() == Settings()


def test_flat_values_have_the_order_of_tables():
    assert flat(Settings()) == dict(zip(NAMES, VALUES, strict=True))
    assert (
        list(flat(Settings())) == list(knobs(Settings)) == [row.name for row in describe(Settings)] == NAMES
    )
    assert [record.path for record in knobs(Settings).values()] == [
        "shading.msaa",
        "loading.mode",
        "shading.sky",
        "loading.threads",
        "cloth.enabled",
        "cloth.substeps",
        "cloth.wind_speed",
    ]
    assert knobs(Settings)["cloth_substeps"].reference == 64


def test_settings_survive_json():
    settings = Settings(msaa=2, loading="wait", wind_speed=0.1)
    assert Settings(**json.loads(json.dumps(flat(settings)))) == settings


def test_a_copy_shares_no_group():
    settings = Settings(decoding_threads=3)
    others = (
        replaced(settings, loading="wait"),
        replace(settings, loading=LoadingSettings("wait", 3)),
        copy.deepcopy(settings),
    )
    for other in others:
        assert other.loading.threads == 3, "what is not named stays"
        other.cloth.wind_speed = 5.0
        other.loading.threads = 4
    assert settings == Settings(decoding_threads=3)


def test_groups_are_given_whole():
    mine = ClothSettings(substeps=2)
    settings = Settings(cloth=mine)
    assert settings == Settings(cloth_substeps=2) and settings.cloth is not mine


def test_groups_and_knobs_are_not_mixed():
    """`dataclasses.replace` gives the groups it does not change: the knob `loading` would drop a group of that name."""
    with pytest.raises(SettingError, match="use replaced"):
        replace(Settings(decoding_threads=3), loading="wait")
    with pytest.raises(SettingError, match="use replaced"):
        Settings(cloth=ClothSettings(), msaa=2)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("mssa", "there is no setting 'mssa'; did you mean 'msaa'?"),
        ("shading.sky", "there is no setting 'shading.sky'; did you mean 'sky'?"),
        ("shading", "there is no setting 'shading': it is a group, which has msaa, sky."),
        ("enabled", "there is no setting 'enabled'; known are 'cloth', "),
    ],
)
def test_an_unknown_name_is_one_sentence(name, sentence):
    for use in (
        lambda: apply_overrides(Settings(), [f"{name}=1"]),
        lambda: Settings(**{name: 1}),
        lambda: replaced(Settings(), **{name: 1}),
    ):
        with pytest.raises(SettingError) as error:
            use()
        assert str(error.value).startswith(sentence) and error.value.exit_code == 2


def test_a_group_is_switched_off_by_its_name():
    before = Settings(cloth_substeps=8)
    after = apply_overrides(before, ["cloth=off", "loading=wait"])
    assert after.cloth == ClothSettings(enabled=False, substeps=8) and after.loading.mode == "wait"
    assert before == Settings(cloth_substeps=8)
    with pytest.raises(SettingError, match="setting cloth must be on or off, not '8'"):
        apply_overrides(before, ["cloth=8"])


def test_presets_name_knobs_flat():
    assert isinstance(preset(Settings, "high").shading.msaa, AtMost)
    assert preset(Settings, "high") == Settings(msaa=4, loading="wait")
    assert preset(Settings, "reference") == Settings(cloth_substeps=64, sky=False)


def test_live_knobs_are_set_in_place():
    settings = Settings()
    cloth = settings.cloth
    assert set_live(settings, Settings(wind_speed=2.0)) and cloth.wind_speed == 2.0
    assert not set_live(settings, Settings(wind_speed=3.0, msaa=2)) and settings == Settings(wind_speed=2.0)
    assert not set_live(settings, Settings(wind_speed=2.0)), "nothing differs"


def test_flat_names_are_neither_read_nor_set_on_the_settings():
    settings: Any = Settings()
    with pytest.raises(AttributeError, match=r"no attribute 'msaa': it is settings\.shading\.msaa"):
        _ = settings.msaa
    with pytest.raises(AttributeError, match="did you mean 'shading'"):
        _ = settings.shadng
    for name, value in (("msaa", 4), ("loading", "wait"), ("cloth", False), ("mssa", 4)):
        with pytest.raises(SettingError, match=f"settings cannot be given '{name}'"):
            setattr(settings, name, value)
    assert settings == Settings() and not hasattr(settings, "msaa")


def test_two_knobs_cannot_have_one_name():
    @dataclass(init=False)
    class Both(Grouped):
        one: ShadingSettings = group(ShadingSettings)
        other: ShadingSettings = group(ShadingSettings)

    with pytest.raises(ValueError, match="two knobs of Both have the name 'msaa'"):
        knobs(Both)


def test_a_knob_can_stand_beside_the_groups():
    @dataclass(init=False)
    class Mine(Settings):
        bloom: float = knob(0.5, "part of the light", minimum=0)

    settings = Mine(msaa=2)
    assert settings.bloom == 0.5 and flat(settings) == flat(Settings(msaa=2)) | {"bloom": 0.5}
    settings.bloom = 0.7
    assert settings == Mine(msaa=2, bloom=0.7) != replaced(settings, bloom=0.1)
    assert apply_overrides(settings, ["bloom=0.1"]).bloom == 0.1


def test_settings_without_groups_have_flat_names_too():
    settings = ClothSettings(substeps=2)
    assert flat(settings) == {"cloth": True, "cloth_substeps": 2, "wind_speed": 0.0}
    assert apply_overrides(settings, ["cloth_substeps=3"]).substeps == 3
