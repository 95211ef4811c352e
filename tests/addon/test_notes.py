"""What a step has to say: a light by the notes' levels, in the panel's language, each where it can be acted on."""

import re

import bpy
import pytest

from blender_addon.operators.choose_file import start_folder
from blender_addon.panels.bake import MPS_PT_bake
from blender_addon.panels.lights import MPS_PT_lights
from blender_addon.panels.photo import MPS_PT_align, MPS_PT_photo
from blender_addon.panels.step import Kind
from blender_addon.panels.traffic_light import worst
from blender_addon.settings.declared import option_of_setting
from blender_addon.settings.messages import in_blender, options_in, recognised, store_sentences
from blender_addon.settings.record import all_notes, notes_of, store_record
from blender_addon.translations import messages
from mpsnet_core.errors import Note

PLACEHOLDER = re.compile(r"%[-+.\d]*[a-z]|%%")


@pytest.mark.parametrize("language", ["de_DE", "zh_HANS"])
def test_every_sentence_keeps_its_placeholders_and_is_known_whatever_values_are_in_it(language, scene):
    pytest.importorskip("babel")
    catalog = messages(language)
    store_sentences(language, catalog)
    assert len(catalog) > 1500
    for english, word in catalog.items():
        assert PLACEHOLDER.findall(english) == PLACEHOLDER.findall(word), english
        if " " in english:
            values = tuple(f"{number}.x" for number in range(len(re.findall(r"%[-+.\d]*[a-z]", english))))
            said, meant = (re.sub(r"%[-+.\d]*[a-z]", "%s", one) % values if values else one for one in (english, word))
            found = recognised(said, language)
            assert found[:1].lower() + found[1:] == meant[:1].lower() + meant[1:], english


def test_what_each_operator_lacks_in_an_empty_scene_is_translated(scene):
    pytest.importorskip("babel")
    store_sentences("de_DE", messages("de_DE"))
    operators = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("MPS_OT_")]
    lacking = {one.lacks(bpy.context) for one in operators if hasattr(one, "lacks")} - {""}
    assert len(lacking) > 5
    assert not [sentence for sentence in lacking if recognised(sentence, "de_DE") == sentence]


def test_a_sentence_within_another_is_translated_and_what_is_unknown_stays(scene):
    pytest.importorskip("babel")
    store_sentences("de_DE", messages("de_DE"))
    assert recognised("Rig 2: starting", "de_DE") == "Rig 2: beginnt"
    assert recognised("reading the mesh", "de_DE") == "Lesen des Meshs"
    inner = "cannot write a.png: the folder b cannot be written to; choose another folder"
    assert recognised(f"Rig 2: {inner}", "de_DE").startswith("Rig 2: a.png lässt sich nicht schreiben")
    named = recognised('there is no object "photo" in the scene; check its name', "de_DE")
    assert "„photo“" in named and "Szene" in named
    for unknown in ("line of sight: nobody", "view the whole scene", "a.png", "", ": ", "it is not known to anybody"):
        assert recognised(unknown, "de_DE") == unknown
    assert recognised("reading the mesh", "xx_XX") == "reading the mesh"


def test_options_are_labels_in_the_sentence_and_fields_below_it(scene):
    note = Note("set the encoding to %s (--encoding), not in %s", "linear", "a/--mask.png")
    assert in_blender(note) == "set the encoding to linear (Encoding), not in a/--mask.png"
    assert options_in(note) == ["encoding"]
    assert option_of_setting(scene.mps.estimate, "encoding") == "encoding"
    assert option_of_setting(scene.mps.estimate, "focal") == "lens"
    assert not option_of_setting(scene.mps.estimate, "lights_in")


def test_the_light_is_that_of_the_worst_note():
    notes = [Note("a", level="good"), Note("is it not there? [x-y]", level="good"), Note("c", level="look")]
    assert worst(notes[:2]) == "good" and worst(notes) == "look"
    assert worst([*notes, Note("d", level="stop")]) == "stop"


def test_what_cannot_be_baked_stops_its_step(photographed, scene, tmp_path):
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "photo.exr"))
    scene.mps.photo.image.mps.fit = "poor fit"
    store_record(scene, "align_photo", notes=[Note("%s", "poor fit", level="stop")])
    state = MPS_PT_align.state(bpy.context)
    assert (state.kind, state.why) == (Kind.STOP, "Poor fit")


def test_a_note_is_shown_once_in_the_step_that_it_is_about(scene):
    clipped, lights = Note("burnt [clipped-photo]", level="look"), Note("found [lights-found]", level="look")
    store_record(scene, "estimate", notes=[clipped, lights, Note("its own")])
    store_record(scene, "show_mask", notes=[clipped])
    assert all_notes(scene.mps).count(clipped) == 2
    scene.mps.way = "PHOTOGRAPH"
    assert MPS_PT_photo.notes_here(bpy.context) == [clipped] and MPS_PT_lights.notes_here(bpy.context) == [lights]
    assert MPS_PT_bake.notes_here(bpy.context, notes_of(scene, "estimate")) == ["its own"]
    scene.mps.way = "RENDER"  # the photo's step is shown, that of the lights is not
    assert MPS_PT_bake.notes_here(bpy.context, notes_of(scene, "estimate")) == [lights, "its own"]


@pytest.mark.parametrize("stored", ["[3]", "{", '[{"level": "good", "template": "%d", "values": ["x"]}]', "a line"])
def test_a_record_of_an_unknown_kind_has_no_notes(scene, stored):
    store_record(scene, "bake", notes=[Note("x")])
    scene.mps.records["bake"].notes = stored
    assert notes_of(scene, "bake") == []


def test_a_new_result_unfolds_its_picture(estimated, scene):
    image = scene.mps.estimate.image
    assert image.mps.shown
    image.mps.shown = False
    bpy.ops.mps.estimate()
    assert scene.mps.estimate.image.mps.shown


def test_a_file_is_chosen_into_its_field_and_the_next_list_opens_beside_it(scene, tmp_path):
    (tmp_path / "a.json").write_text("{}")
    group = scene.mps.estimate.path_from_id()
    bpy.ops.mps.choose_file(group=group, setting="rig_file", filepath=str(tmp_path / "a.json"))
    assert bpy.path.abspath(scene.mps.estimate.rig_file) == str(tmp_path / "a.json")
    assert start_folder(bpy.context) == f"{tmp_path}/"
    (tmp_path / "sub").mkdir()
    assert start_folder(bpy.context, str(tmp_path / "sub" / "b.png")) == f"{tmp_path / 'sub'}/"
