"""FMUs are looked into before anything of them is run: harmful, foreign and unfit ones are refused in one line."""

import os
import stat
import sys
import zipfile

import pytest

from harness.common.errors import UserError
from harness.external.fmu import archive
from harness.external.fmu.model import read_model
from harness.external.fmu.read import describe, parameters
from support.fmus import SPRING, SPRING_MAP, make, needs_compiler

DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>{doctype}
<fmiModelDescription fmiVersion="{version}" modelName="truck" guid="g"><{kind} modelIdentifier="truck" {attributes}/>
<ModelVariables>{variables}</ModelVariables><ModelStructure/></fmiModelDescription>"""


def description(version="2.0", kind="CoSimulation", attributes="", variables="", doctype=""):
    return DESCRIPTION.format(version=version, kind=kind, attributes=attributes, variables=variables, doctype=doctype)


def fmu(folder, xml=None, entries=()):
    path = folder / "truck.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as zipped:
        if xml is not None:
            zipped.writestr("modelDescription.xml", xml)
        for name, content in entries:
            zipped.writestr(name, content)
    return path


def link():
    entry = zipfile.ZipInfo("binaries/linux64/truck.so")
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return entry


def pipe():
    entry = zipfile.ZipInfo("resources/pipe")
    entry.external_attr = (stat.S_IFIFO | 0o666) << 16
    return entry


HARM = {
    "up": ([("../evil.so", "x")], "leads out of its folder"),
    "up inside": ([("resources/../../evil.so", "x")], "leads out of its folder"),
    "up windows": ([("resources\\..\\..\\evil.so", "x")], "leads out of its folder"),
    "absolute": ([("/etc/evil", "x")], "absolute path"),
    "drive": ([("C:/evil.dll", "x")], "absolute path"),
    "link": ([(link(), "/etc/passwd")], "is a link"),
    "pipe": ([(pipe(), "")], "is no plain file"),
    "twice": ([("resources/./a", "x"), ("resources/a", "y")], "is there twice"),
}


@pytest.mark.parametrize("harm", HARM)
def test_an_archive_that_would_do_harm_is_refused(harm, tmp_path):
    entries, reason = HARM[harm]
    path = fmu(tmp_path, description(), entries)
    with pytest.raises(UserError, match=reason) as refusal:
        read_model(path)
    assert "\n" not in str(refusal.value)
    with pytest.raises(UserError, match=reason):
        archive.unpack(path, tmp_path / "unpacked")
    assert not (tmp_path / "unpacked").exists()


def test_an_encrypted_archive_is_refused(tmp_path):
    path = fmu(tmp_path, description())
    content = bytearray(path.read_bytes())
    content[content.index(b"PK\1\2") + 8] |= 1
    path.write_bytes(content)
    with pytest.raises(UserError, match="is encrypted"):
        read_model(path)


def test_an_archive_too_large_or_of_too_many_files_is_refused(tmp_path, monkeypatch):
    path = fmu(tmp_path, description(), [("resources/zeros", bytes(10_000_000))])
    assert path.stat().st_size < 20_000
    monkeypatch.setattr(archive, "LARGEST", 9_000_000)
    with pytest.raises(UserError, match=r"0.00931 GiB when unpacked"):
        read_model(path)
    monkeypatch.undo()
    monkeypatch.setattr(archive, "ENTRIES", 1)
    with pytest.raises(UserError, match="has 2 entries"):
        read_model(path)


def test_an_archive_that_understates_its_size_unpacks_to_what_it_states(tmp_path):
    path = fmu(tmp_path, description(), [("resources/zeros", bytes(10_000_000))])
    content = path.read_bytes()
    path.write_bytes(content.replace((10_000_000).to_bytes(4, "little"), (100).to_bytes(4, "little")))
    with pytest.raises(UserError, match="cannot be unpacked"):
        archive.unpack(path, tmp_path / "unpacked")


DAMAGED = {
    "no zip": (b"hello", "is no FMU, which is a zip file"),
    "empty": (b"", "is no FMU, which is a zip file"),
    "cut": (None, "cut short"),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_archive_is_refused(damage, tmp_path):
    content, reason = DAMAGED[damage]
    path = fmu(tmp_path, description())
    path.write_bytes(path.read_bytes()[:-30] if content is None else content)
    with pytest.raises(UserError, match=reason):
        read_model(path)


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path):
    for make_other in (os.mkfifo, os.mkdir):
        path = tmp_path / f"{make_other.__name__}.fmu"
        make_other(path)
        with pytest.raises(UserError, match="is no regular file"):
            read_model(path)


REAL = '<ScalarVariable name="{}" valueReference="{}" causality="output"><Real/></ScalarVariable>'
BOMB = "<!DOCTYPE a [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'><!ENTITY c '&b;&b;&b;&b;&b;&b;'>]>"
OUTSIDE = '<!DOCTYPE a SYSTEM "file:///etc/passwd">'
FOREIGN = {
    "no description": (None, "there is no modelDescription.xml"),
    "no XML": ("<fmiModelDescription", "is no XML"),
    "no FMU": ("<html/>", "describes no FMU"),
    "bomb": (description(doctype=BOMB), "document type"),
    "outside": (description(doctype=OUTSIDE), "document type"),
    "FMI 1": (description("1.0"), "is of FMI 1.0; export it as FMI 2.0 or 3.0"),
    "FMI 4": (description("4.0"), "2.0 and 3.0 are known"),
    "beta": (description("3.0-beta.2"), "2.0 and 3.0 are known"),
    "scheduled": (description("3.0", "ScheduledExecution"), "neither co-simulation nor model exchange"),
    "library elsewhere": (
        description().replace('modelIdentifier="truck"', 'modelIdentifier="../../evil"'), "which no file is called"
    ),
    "twice": (description(variables=REAL.format("v", 0) + REAL.format("v", 1)), "'v' is there twice"),
    "no number": (description(variables=REAL.format("v", "x")), "cannot be read"),
}  # fmt: skip


@pytest.mark.parametrize("kind", FOREIGN)
def test_a_description_that_does_not_do_is_refused(kind, tmp_path):
    xml, reason = FOREIGN[kind]
    with pytest.raises(UserError, match=reason) as refusal:
        read_model(fmu(tmp_path, xml))
    assert "\n" not in str(refusal.value)


PLATFORMS = {
    "another platform": ([("binaries/mars64/truck.so", "")], "its binaries are for mars64"),
    "sources": ([("sources/all.c", "")], "it has C code only"),
    "nothing": ([], "it has no binary"),
}


@pytest.mark.parametrize("binaries", PLATFORMS)
def test_an_fmu_without_a_binary_for_this_platform_says_what_there_is(binaries, tmp_path):
    entries, reason = PLATFORMS[binaries]
    with pytest.raises(UserError, match=reason):
        describe(fmu(tmp_path, description(), entries), SPRING_MAP)


def test_a_library_that_is_none_is_one_line(tmp_path):
    from fmpy import platform, sharedLibraryExtension

    from harness.external.fmu.instance import Library

    path = fmu(tmp_path, description(), [(f"binaries/{platform}/truck{sharedLibraryExtension}", "no library")])
    with pytest.raises(UserError, match=r"cannot be loaded: file too short") as refusal:
        Library(read_model(path), "co-simulation")
    assert "\n" not in str(refusal.value)


@pytest.fixture(scope="module")
def spring(tmp_path_factory):
    return make(tmp_path_factory.mktemp("spring"), SPRING)


@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_parameters_have_their_units_bounds_and_names(version, tmp_path):
    described = describe(make(tmp_path, SPRING, version), SPRING_MAP)
    mass, k = described.parameters
    assert (mass.name, mass.variable, mass.unit, mass.value) == ("mass", "body.m", "kg", 2.0)
    assert (mass.lower, mass.upper) == (1.0, 3.0)
    assert (k.name, k.value, k.unit) == ("k", 5.0, "dimensionless")
    assert described.inputs[0].unit == "rad"
    assert described.inputs[0].scale == pytest.approx(0.017453292519943295, rel=1e-15)
    assert described.facts["fmi_version"] == f"{version}.0"


@needs_compiler
def test_units_of_a_map_come_before_those_of_the_fmu(spring):
    content = SPRING_MAP | {
        "parameters": {"mass": {"variable": "body.m", "unit": "t", "lower": "500 kg"}},
        "outputs": {"heading": {"variable": "rate", "unit": "rad", "scale": -2}},
        "limits": {"heading": "60 deg"},
        "vehicle": {"wheelbase": "360 cm", "steering_ratio": 20},
    }
    described = describe(spring, content)
    assert (described.parameters[0].value, described.parameters[0].lower) == (2000.0, 500.0)
    assert described.outputs[0].scale == -2.0
    assert described.limits["heading"] == pytest.approx(1.0471975511965976)
    assert (described.wheelbase, described.steering_ratio) == (pytest.approx(3.6), 20.0)


UNFIT = {
    "signal": ({"outputs": {"yaw_rat": "rate"}}, "outputs.yaw_rat: no such signal; closest: yaw_rate"),
    "variable": ({"outputs": {"heading": "rat"}}, "no variable 'rat'; closest: rate"),
    "dimension": ({"outputs": {"speed": "rate"}}, "outputs.speed: 'rate': its unit 'deg' is rad in base units"),
    "unit": ({"outputs": {"speed": {"variable": "rate", "unit": "furlong"}}}, "outputs.speed.unit"),
    "no unit": ({"inputs": {"speed": "force"}}, "states no unit for 'force'"),
    "key": ({"outputs": {"heading": {"variable": "rate", "sign": -1}}}, "unknown key 'sign'"),
    "no variable": ({"outputs": {"heading": {"unit": "rad"}}}, "expected the name of a variable"),
    "table": ({"output": {}}, "unknown table 'output'; closest: outputs"),
    "no table": ({"outputs": 3}, "outputs: expected a table"),
    "scale": ({"outputs": {"heading": {"variable": "rate", "scale": 0}}}, "scale: 0 would make nothing"),
    "output as input": ({"inputs": {"heading": "rate"}}, "'rate' is an output of the FMU, no input"),
    "parameter as output": ({"outputs": {"heading": "k"}}, "'k' is a parameter of the FMU, no output"),
    "twice": ({"process_noise": {"wind": "delta"}}, "given both steering_wheel_angle and wind"),
    "nothing": ({"outputs": {}}, "publishes something"),
    "limit": ({"limits": {"speed": "3 m/s"}}, "limits: unknown published signal 'speed'"),
    "limit unit": ({"limits": {"heading": "3 m/s"}}, "limits.heading"),
    "no parameter": ({"parameters": {"p": "rate"}}, "none that can be set"),
    "name taken": ({"parameters": {"k": "body.m"}}, "parameters.k: is the name of another parameter"),
    "negative limit": ({"limits": {"heading": "-60 deg"}}, "limits.heading: must be positive"),
    "no wheelbase": ({"vehicle": {"wheelbase": "0 m"}}, "vehicle.wheelbase: must be positive"),
    "negative ratio": ({"vehicle": {"steering_ratio": -16}}, "vehicle.steering_ratio: must be positive"),
    "start": (
        {"parameters": {"mass": {"variable": "body.m", "lower": "2.5 kg"}}},
        "starts at 2 kg, outside its bounds",
    ),
    "bounds": ({"parameters": {"mass": {"variable": "body.m", "lower": "4 kg"}}}, "lower bound 4 is above"),
}


@needs_compiler
@pytest.mark.parametrize("kind", UNFIT)
def test_a_map_that_does_not_do_names_file_and_key(kind, spring):
    change, reason = UNFIT[kind]
    with pytest.raises(UserError) as refusal:
        describe(spring, SPRING_MAP | change, "truck.toml")
    assert str(refusal.value).startswith("truck.toml: ")
    assert reason in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("unit", "attributes", "words"),
    [
        ("nothing", 'start="2"', "the unit of 'm' is 0 times the SI unit"),
        ("kg", 'start="2" min="3" max="1"', "truck.fmu: its variable 'm' has the minimum 3 above the maximum 1"),
        ("kg", 'start="2" min="3"', "truck.fmu: parameters.m: it starts at 2 kg, outside its bounds"),
    ],
)
def test_an_fmu_whose_own_units_or_bounds_cannot_be_is_named(unit, attributes, words, tmp_path):
    declared = 'name="m" valueReference="0" causality="parameter" variability="fixed"'
    variables = f'<ScalarVariable {declared}><Real {attributes} unit="{unit}"/></ScalarVariable>'
    defined = '<UnitDefinitions><Unit name="nothing"><BaseUnit kg="1" factor="0"/></Unit></UnitDefinitions>'
    xml = description(variables=variables).replace("<ModelVariables>", f"{defined}<ModelVariables>")
    path = fmu(tmp_path, xml)
    with pytest.raises(UserError) as refusal:
        parameters(read_model(path), {}, str(path))
    assert words in str(refusal.value)


@needs_compiler
def test_variables_called_as_signals_need_no_map(tmp_path):
    from dataclasses import replace

    named = replace(SPRING, inputs={"steering_wheel_angle": "deg", "wind": ""}, outputs={"heading": "deg", "b": "rad"})
    described = describe(make(tmp_path, named), None)
    assert [p.signal for p in described.inputs] == ["steering_wheel_angle"]
    assert [p.signal for p in described.outputs] == ["heading"]
    with pytest.raises(UserError, match="harness new plant"):
        describe(make(tmp_path, SPRING), None)


UNITS = [("N.m", "N*m"), ("kg.m2", "kg*m^2"), ("m/s2", "m/s^2"), ("1", "dimensionless"), ("", "dimensionless")]


@pytest.mark.parametrize(("modelica", "pint"), UNITS)
def test_units_are_read_as_modelica_writes_them(modelica, pint):
    from harness.external.fmu.units import stated

    assert stated(modelica, "", "map") == (1.0, 0.0, pint)


@pytest.mark.parametrize(
    ("unit", "expected"), [("degC", (1.0, 273.15, "K")), ("km/h", (1 / 3.6, 0.0, "m/s")), ("t", (1000.0, 0.0, "kg"))]
)
def test_a_parameter_is_in_si(unit, expected):
    from harness.external.fmu.units import stated

    scale, offset, si = stated(unit, "", "map")
    assert (scale, offset, si) == (pytest.approx(expected[0]), pytest.approx(expected[1]), expected[2])


def test_without_fmpy_one_line_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(UserError, match=r"pip install 'robustness-harness\[fmu\]'"):
        read_model(fmu(tmp_path, description()))


@pytest.mark.parametrize(
    ("name", "definition", "factor"),
    [
        ("rad/s", '<BaseUnit s="-1"/>', 1.0),
        ("deg/s", '<BaseUnit s="-1" factor="0.017453292519943295"/>', 0.017453292519943295),
        ("Hz", '<BaseUnit s="-1"/>', None),
        ("rpm", '<BaseUnit s="-1" rad="1" factor="0.10471975511965977"/>', 0.10471975511965977),
        ("rad/s", '<BaseUnit s="-1" factor="2"/>', None),
    ],
)
def test_a_definition_that_does_not_know_the_radian_counts_where_the_name_does(name, definition, factor, tmp_path):
    from harness.external.fmu.units import of_variable

    xml = description().replace("<ModelVariables>", f'<UnitDefinitions><Unit name="{name}">{definition}</Unit>'
                                "</UnitDefinitions><ModelVariables>")  # fmt: skip
    model = read_model(fmu(tmp_path, xml))
    if factor is None:
        with pytest.raises(UserError, match=f"its unit '{name}'"):
            of_variable(model, name, "rad/s", "map: yaw_rate")
    else:
        assert of_variable(model, name, "rad/s", "map").scale == pytest.approx(factor, rel=1e-15)


def test_an_fmu_that_offers_both_is_used_as_it_is_asked_for(tmp_path):
    from fmpy import platform, sharedLibraryExtension

    xml = description(variables=REAL.format("yaw_rate", 0)).replace(
        "<ModelVariables>", '<ModelExchange modelIdentifier="truck_me"/><ModelVariables>'
    )
    libraries = [(f"binaries/{platform}/{name}{sharedLibraryExtension}", "") for name in ("truck", "truck_me")]
    path = fmu(tmp_path, xml, libraries)
    content = {"outputs": {"yaw_rate": {"variable": "yaw_rate", "unit": "rad/s"}}}
    interfaces = [describe(path, content, interface=i).facts["interface"] for i in (None, "model-exchange")]
    assert interfaces == ["co-simulation", "model-exchange"]
    with pytest.raises(UserError, match="offers co-simulation and model-exchange, not scheduled"):
        describe(path, content, interface="scheduled")
