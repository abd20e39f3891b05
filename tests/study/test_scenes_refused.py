"""What scenes refuse and what they say about it: nothing wrong gets through or ends in a traceback.

Bounds, types and names of single keys are in test_keys_refused.py.
"""

import os
import subprocess
import sys
from pathlib import Path

import hypothesis.strategies as st
import pytest
from effort import examples
from hints import Capture, Folders, Patch
from hypothesis import given, settings
from places import SAVED

import wormopt as wo
from tests.oracles import by_text
from tests.oracles.by_text import DESIGN, MODEL, OWN, PARETO, TRACK, write
from wormopt.cli import main
from wormopt.errors import SceneError
from wormopt.study import load_scene

# Base scene, change as for --set (a bare key is taken out) | key | part of the message.
HOSTILE = """
design schema=2 | schema | write 1
design schema | schema | missing
design kind="gait-desing" | kind | "gait-design"
design kind | kind | missing
design units="cgs" | units | "SI"
design want=["gaits"] | want[0] | "motion"
design want="gait" | want | a list
design want=["gait", "gait"] | want | twice
pareto want=["animation"] | want[0] | "front"
design title="a\\nb" | title | one line
design worm.mass=1979-05-27 | worm.mass | finite
design worm.mass=[1, 1] | worm.mass | 2 entries for 3 masses
design gait.period=[2, 1] | gait.period | empty
design gait.period=[1, 2, 3] | gait.period | [smallest, largest]
design gait.length=[1.3, 0.7] | gait.length | empty
design gait.length=[1, 1] | gait.length | empty
design gait.length=[1] | gait.length | 2 such pairs
design gait.length=[[1, 2]] | gait.length | 2 such pairs
design gait.length=[1, [1, 2]] | gait.length | 2 such pairs
design gait.length=[[1, 2], [2, 1]] | gait.length[1] | empty
design gait.length=[[1, 2], [1, 2, 3]] | gait.length[1] | such pairs
design gait.resting=3 | gait.resting | at most 2
design gait.rate=[1] | gait.rate | 1 entry for 2 links
design gait.rate={contraction=1} | gait.rate.extension | missing
design gait.rate={contraction=1, extension=[1, 2, 3]} | gait.rate.extension | 3 entries for 2 links
design gait.acceleration=[1, 2, 3] | gait.acceleration | 3 entries for 2 links
design gait.spike_load=[1, 2] | gait.spike_load | 2 entries for 3 masses
design gait.actuator_force=[1] | gait.actuator_force | 1 entry for 2 links
design gait.acceleration | gait.acceleration | velocities may jump
design gait.impulses=true | gait.impulses | remove one of them
design objective={} | objective | no objective
design objective.minimise="peak_spike_load" | objective | maximise and minimise
design objective={minimise="peak_spike_load"} | objective.speed | missing
design objective.speed=0.5 | objective.speed | remove one of them
design search.sequence=[[0]] | search.sequence | two
design search.sequence=[[0], [3]] | search.sequence[1] | indices 0 to 2
design search.sequence=[[0], [0]] | search.sequence[0] | the same masses
design search.sequence=[[0], [1], [0]] | search.sequence[0] | the same masses
design search.sequence=[[0], [1, 1]] | search.sequence[1] | twice
design search.sequence=[[0], []] | search.sequence[1] | fewer resting masses
design search={phases=2, sequence=[[0], [1], [2]]} | search.sequence | search.phases = 2
design search.sequence=[[0,1],[0,2]] | search.sequence | mass 0 rests in every phase
gait gait.shape | gait.shape | missing
gait gait.elongation=0.1 | gait.elongation | with shape = "block_wave"
gait gait.profile="trapezoid" | gait.ramp | missing
gait gait.ramp=0.1 | gait.ramp | no ramp
gait gait={shape="accordion", period=1, length=[1, 2], resting=1} | gait.resting | shape
gait gait={shape="accordion",period=1,length=[1,2],profile="trapezoid",ramp=1} | gait.ramp | 0 to
fast worm.links=3 | gait.shape | 2 links
file gait.file="no.csv" | gait.file | cannot be read
file gait.file="scene.toml" | gait.file | no known suffix
file gait.file="sub.csv" | gait.file | cannot be read
file gait.file="a\\u0000.csv" | gait.file | cannot be read
file gait.file="" | gait.file | name of a .csv or .nc file
file schema=1 | gait.file | missing
material units | units | units = "SI"
material material.u0 | material.u0 | missing
material material.field | material.field | missing
material material.mu_r=2.0 | material | not both
design worm.links=three | worm.links | whole number
design worm.links= | worm.links | in quotes
design worm..links=3 | worm..links | key=value
design =3 | --set | key=value
design kind.name=3 | kind.name | not a table
track worm.links=3 | reference.gait.shape | 2 links
track worm.mass=[1, 1] | worm.mass | one number for all masses, or a list of 3
track worm.mass=1e-40 | worm.mass | 1e-40 is too small for computing
track worm.mass=1e40 | worm.mass | 1e+40 is too large for computing
track worm.mass=[1, 1e-40, 1] | worm.mass[1] | choose units
track worm.friction=[{kind="spike"}, {kind="spike"}] | worm.friction | one table for all masses, or
track worm.damping=[1, 2, 3] | worm.damping | 3 entries for 2 links
simulate worm.friction.forward=1e300 | worm.friction.forward | choose units
track tracker=3 | tracker | a table with feedback = "filter", "derivative",
track tracker=3 | tracker | or "funnel", or a list of such
track worm.friction.forward=[1, 1] | worm.friction.forward | 2 entries for 3 masses
track worm.friction.stick_forward=0.5 | worm.friction.stick_forward | below the sliding
track worm.friction.drag=1 | worm.friction.drag | with kind = "coulomb"
track worm.friction=[{kind="spike"}] | worm.friction | 1 entry for 3 masses
track worm.friction=[{kind="spike"},{kind="spike"},{kind="spi"}] | worm.friction[2].kind | "spi"
track worm.friction=[{kind="spike"}, {kind="spike"}, {kind="viscous", drag=[1, 1, 1]}] \
| worm.friction[2].drag | for one mass
track worm.random={} | worm.random | contains nothing random
track worm.random.stiffness={process="fixed", spread=10} | worm.random.stiffness.spread | not below
track worm.random.damping={process="fixed", spread=[1, 1, 1]} | worm.random.damping.spread | 3 entr
track worm.random.damping={process="steps", spread=1, interval=1e-9} \
| worm.random.damping.interval | more than 1000000 pieces
track start.position=[1, 2] | start.position | 2 entries for 3 masses
track reference.gait={shape="file", file="no.csv"} | reference.gait.file | cannot be
track reference.gait={shape="block_wave",period=1,length=[2, 1]} | reference.gait.length | empty
track tracker=[] | tracker | at least one
track tracker=[{feedback="pid"}] | tracker[0].feedback | "pid" is not allowed
track tracker.filter_start=1 | tracker.filter_start | with feedback = "derivative"
track tracker={feedback="filter", tube_radius=1, filter_start=[1, 2, 3]} | tracker.filter_start \
| 3 entries for 2 links
track tracker.feedforward.stiffness=[1] | tracker.feedforward.stiffness | 1 entry for 2 links
track tracker={feedback="difference", lag=1e-7, tube_radius=1} | tracker.lag \
| 2e+07 stretches; write 2e-05 or more
track tracker={feedback="switching", tube_radius=1, settling=1, overshoot=1, filter_start=[1]} \
| tracker.filter_start | 1 entry for 2 links
track ensemble.members=5 | ensemble | would have equal members
track want=["bands"] | want | needs an ensemble
random want=["motion"] | want | write "bands"
track want=["spikes"] | want[0] | "trackers"
simulate model.file="a.py:build" | model | both
simulate actuation={law="constant", force=[1]} | actuation.force | 1 entry for 2 links
simulate actuation={law="harmonic", amplitude=[1, 2, 3], period=1} | actuation.amplitude | 3 entries
simulate actuation={law="gait", gait={shape="file", file="no.csv"}} | actuation.gait.file | cannot
simulate want=["trackers"] | want[0] | "motion"
model model.file="own.py" | model.file | "file.py:function"
model model.file="own.txt:build" | model.file | "file.py:function"
model model.file="own.py:a b" | model.file | "file.py:function"
model model.file="none.py:build" | model.file | cannot be read
model model.file="folder.py:build" | model.file | cannot be read
model model.file="broken.py:build" | model.file | broken.py line 2
model model.file="null.py:build" | model.file | null.py
model start.velocity=1 | start | applies to [worm]
model actuation={law="constant", force=1} | actuation | applies to [worm]
model want=["motion"] | want | "signals"
model model.parameters.rate=nan | model.parameters.rate | finite
model model.parameters.rate=1979-05-27 | model.parameters.rate | finite
"""

# What no line of text holds.
HOSTILE_TEXTS = [
    ("design", "worm.links=3\nb=4", "worm.links", "in quotes"),
    ("design", 'title="\udcff"', "title", "in quotes"),
    ("design", "worm.mass=" + "[" * 5000 + "]" * 5000, "worm.mass", ""),
]

HOSTILE_FILES = [
    (b"schema = ", "not valid TOML"),
    (b"schema = 1\nschema = 1", "not valid TOML"),
    (b"[worm]\n[worm]", "not valid TOML"),
    (b"a = 1\nmass = 80 g  # each\n", 'put a value with a unit in quotes: "80 g"'),
    (b"a = 1\nlength = [50mm, 70mm]", 'quotes: "50mm"'),
    (b"\xff\xfe", "not UTF-8"),
    (b"a = " + b"[" * 20000, "nested too deeply"),
    (b"a = " + b"9" * 5000, "not valid TOML"),
    (b"\x00", "not valid TOML"),
    (b"", "kind: missing"),
    (b"[[kind]]", "kind: "),
]

# What may be wrong with the user's file once it runs: text, part of the message.
HOSTILE_MODELS = [
    ("x = 1 / 0\ndef build(): pass", "own.py line 1: ZeroDivisionError: division by zero"),
    ("import no_such_module_at_all as build", "line 1: ModuleNotFoundError"),
    ("import sys\nsys.exit(3)\nbuild = 3", "line 2: SystemExit: 3"),
    ("", "no function build; define it"),
    ("def biuld(): pass", 'write "own.py:biuld"'),
    ("build = 3", "no function build"),
    ("def build():\n    return None", "returns nothing, not a Model"),
    ("def build():\n    return {}", "returns dict, not a Model"),
    ("def build():\n    pass\n    raise ValueError('no legs')", "line 3: ValueError: no legs"),
    ("def build(a):\n    return None", "model.parameters.a: missing"),
    (OWN.replace("value=1.0", "value=(1.0, 2.0)"), "value of x has 1 entry, not 2"),
    (OWN.replace('"x", x', '"time", x'), "'time' is already used"),
    (OWN.replace('"x", x', '"x 1", x'), "is not a valid name"),
    (OWN.replace("ode=-rate * x", 'ode=-ca.SX.sym("c") * x'), ": c; add them"),
    (OWN.replace("ca.SX", "ca.MX"), "of CasADi's SX symbols"),
    (OWN.replace("=1.0)]", '=1.0, unit="lenght")]'), "is 'lenght'; did you mean 'length'?"),
    (OWN.replace("=1.0)]", "=1.0, unit=3)]"), "the unit of 'x' is 3; write"),
    (OWN.replace("ode=-rate * x", "ode=ca.SX(2, 1)"), "line 6: ArgumentError"),
    (OWN.replace("[Signal", "[] and [Signal").replace("-rate * x", "ca.SX(0, 1)"), "no st"),
]


def lines() -> list[tuple[str, str, str, str]]:
    """Rows of HOSTILE: name of the scene, change, key, part of the message."""
    rows = [line.rsplit(" | ", 2) for line in HOSTILE.strip().splitlines()]
    return [(*row[0].strip().split(" ", 1), *row[1:]) for row in rows]  # pyright: ignore


def changed(text: str, change: str) -> tuple[str, list[str]]:
    """Text of a scene and overrides for a change; a bare key is taken out."""
    if "=" in change:
        return text, [change]
    last = change.split(".")[-1]
    return "\n".join(line for line in text.splitlines() if not line.startswith(f"{last} =")), []


@pytest.mark.parametrize(("name", "change", "key", "message"), [*lines(), *HOSTILE_TEXTS])
def test_a_wrong_scene_is_refused_with_file_and_key(
    name: str, change: str, key: str, message: str, tmp_path: Path, capsys: Capture
):
    text, overrides = changed(getattr(by_text, name.upper()), change)
    path = write(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load_scene(path, overrides)
    assert any(key == found and message in said for found, said in caught.value.faults), caught
    sets = [word for override in overrides for word in ("--set", override)]
    assert main(["run", str(path), "-o", str(tmp_path / "out"), *sets]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert f"{path}: {key}: " in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("content", "message"), HOSTILE_FILES)
def test_a_wrong_file_is_refused(tmp_path: Path, capsys: Capture, content: bytes, message: str):
    path = write(tmp_path, content)
    assert main(["check", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"{path}: ")
    assert message in err


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no_such.toml", "no such file"),
        ("design_fast_gate", "did you mean design_fast_gait"),
        ("", "not a file"),
        (".", "not a file"),
        ("a\0b", "no such file"),
        ("x" * 5000, "cannot be read"),
    ],
)
def test_a_missing_file_is_refused(
    tmp_path: Path, monkeypatch: Patch, capsys: Capture, name: str, message: str
):
    monkeypatch.chdir(tmp_path)
    assert main(["run", name]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root reads every file")
def test_an_unreadable_file_is_refused(tmp_path: Path, capsys: Capture):
    path = write(tmp_path, DESIGN)
    path.chmod(0)
    assert main(["check", str(path)]) == 2
    assert "cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize(
    "content", [b"schema = ", b'schema = 1\nkind = "gait"\n[worm]\nmass = nan']
)
def test_a_process_ends_with_two_and_no_traceback(tmp_path: Path, content: bytes):
    path = write(tmp_path, content)
    command = [sys.executable, "-m", "wormopt", "run", str(path), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert str(path) in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(("own", "message"), HOSTILE_MODELS)
def test_a_wrong_model_is_refused_with_file_and_line(
    tmp_path: Path, capsys: Capture, own: str, message: str
):
    path = write(tmp_path, MODEL, own)
    # checking runs nothing, and finds what the text shows
    shown = any(text in message for text in ("define it", "biuld", ".a: missing"))
    assert main(["check", str(path)]) == (2 if shown else 0)
    capsys.readouterr()
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(
        f"{path}: {'model.parameters.a' if 'def build(a)' in own else 'model.file'}: "
    )
    assert message in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "own",
    [
        "from elsewhere import *",
        "import elsewhere.build as build",
        "from elsewhere import build",
        "def __getattr__(name): ...",
        "exec('def build(): pass')",
        "globals().update(build=print)",
        "if True:\n    def build(): ...",
        "for build in [print]: ...",
        "def build(a): ...\nbuild = build",
        "@fit\ndef build(a): ...",
        "def build(a=1, *, b=2, **c): ...",
    ],
)
def test_checking_refuses_no_function_that_may_be_there(tmp_path: Path, own: str):
    assert main(["check", str(write(tmp_path, MODEL, own)), "--set", "model.parameters.b=1"]) == 0


def test_checking_names_parameters_without_running_the_file(tmp_path: Path, capsys: Capture):
    own = "import no_such_module_at_all\ndef build(a, /, b, c=1, *, d, e=2): ..."
    assert main(["check", str(write(tmp_path, MODEL, own)), "--set", "model.parameters.f=1"]) == 2
    found = [line.split(": ")[1] for line in capsys.readouterr().err.splitlines()]
    assert found == [f"model.parameters.{name}" for name in "fbd"]


BOUNDED = (
    OWN.replace("-rate * x)", "-r * x, p=[Signal('rate', r, lower=0, value=rate)])")
).replace("    x = ", '    r = ca.SX.sym("r")\n    x = ')


@pytest.mark.parametrize(
    ("own", "given", "key", "message"),
    [
        (OWN, ["raet=2"], "model.parameters.raet", "did you mean rate"),
        ("1 / rate", ["rate=0"], "model.parameters.rate", "own.py line 2: ZeroDivisionError"),
        (
            "1 / rate",
            ["rate=0", "size=2"],
            "model.parameters",
            "write other values, or correct the file",
        ),
        (
            "assert size > 0, 'size: above 0'",
            ["rate=1", "size=0"],
            "model.parameters.size",
            "size: abo",
        ),
        (BOUNDED, ["rate=-2"], "model.parameters.rate", "rate must be 0 or above, not -2"),
    ],
)
def test_wrong_parameters_of_a_model_are_named(
    tmp_path: Path, own: str, given: list[str], key: str, message: str
):
    whole = own if "def build" in own else f"def build(rate=1, size=1):\n    {own}\n"
    path, changes = write(tmp_path, MODEL, whole), [f"model.parameters.{each}" for each in given]
    with pytest.raises(SceneError) as caught:
        wo.run(path, changes)
    ((found, said),) = caught.value.faults
    assert found == key
    assert message in said


TRACKERS = 'tracker=[{feedback="filter", tube_radius=0}, {feedback="funnel", gain=-1}]'


@pytest.mark.parametrize(
    ("text", "changes", "keys"),
    [
        (
            DESIGN.replace("mass = 1.0", "mass = -1\nlode = 3"),
            ["gait.length=true", "objective.speed=nan", "search.seed=0.5"],
            "worm.mass worm.lode gait.length objective.speed search.seed",
        ),
        # within tables, and, once each table is right, between them
        (DESIGN, ["worm.mass=[1]", "objective.speed=1"], "worm.mass objective.speed"),
        (DESIGN, ["gait.resting=3", "gait.length=[2, 1]"], "gait.resting gait.length"),
        (
            TRACK,
            [TRACKERS],
            "tracker[0].tube_radius tracker[1].gain tracker[1].funnel tracker[1].rate_funnel",
        ),
    ],
)
def test_all_faults_are_found_at_once(tmp_path: Path, text: str, changes: list[str], keys: str):
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, text), changes)
    assert sorted(key for key, _ in caught.value.faults) == sorted(keys.split())
    assert len(str(caught.value).splitlines()) == len(keys.split())


IMPULSES = ("acceleration = 20.0", "impulses = true")


@pytest.mark.parametrize(
    "change",
    [
        *(
            f'objective={{minimise="{cost}", speed=0.1}}'
            for cost in "peak_spike_load peak_actuator_force energy_per_distance "
            "acceleration_effort".split()
        ),
        "gait.actuator_force=10",
        "gait.spike_load=30",
    ],
)
def test_impulses_exclude_what_they_make_infinite(tmp_path: Path, change: str):
    path = write(tmp_path, DESIGN.replace(*IMPULSES))
    load_scene(path)
    with pytest.raises(SceneError, match="impulse"):
        load_scene(path, change)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PARETO.replace(*IMPULSES), "no finite value"),
        (
            DESIGN.replace("acceleration = 20.0", "").replace("rate = 1.0", "impulses = true"),
            r"neither gait\.rate nor gait\.acceleration",
        ),
    ],
)
def test_what_impulses_leave_infinite_is_refused(tmp_path: Path, text: str, message: str):
    with pytest.raises(SceneError, match=message):
        load_scene(write(tmp_path, text))


@pytest.mark.parametrize("cost", ["energy_per_distance", "acceleration_effort"])
def test_a_smooth_cost_needs_one_load(tmp_path: Path, cost: str):
    said = f"{cost} depends on the load, and worm.load is a range"
    for text, key, own in (
        (DESIGN, "objective.minimise", f'objective={{minimise="{cost}", speed=0.1}}'),
        (PARETO, "pareto.against", f'pareto.against="{cost}"'),
    ):
        with pytest.raises(SceneError, match=f"{key}: {said}"):
            load_scene(write(tmp_path, text), [own, "worm.load=[1, 2]"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("start.position.3=1", r"start.position is a list; its entries are start.position.0 to 2"),
        ("start.position.x=1", r"start.position is a list; its entries are start.position.0 to 2"),
        ("worm.mass.0=1", r"worm.mass is not a table or list; .* as a whole: worm.mass=\[...\]"),
    ],
)
def test_entries_that_are_not_there_are_refused(tmp_path: Path, change: str, message: str):
    with pytest.raises(SceneError, match=message):
        load_scene(write(tmp_path, TRACK), [change])


@pytest.mark.parametrize(
    ("changes", "refused"),
    [
        (["gait.spike_load=5"], True),
        (["gait.spike_load=[1e-9, 10, 4.9]"], True),
        (["gait.spike_load=5.01"], False),
        (["gait.spike_load=1e-9", "worm.load=0"], False),
    ],
)
def test_spikes_that_cannot_bear_the_load_are_refused(changes: list[str], refused: bool):
    """Momentum over a cycle: three masses of load 5 rest on their spikes with 15 on average."""
    if not refused:
        assert load_scene("design_spike_limited", changes)
        return
    with pytest.raises(SceneError, match=r"gait.spike_load: .* load of the worm, 15, .* than 5"):
        load_scene("design_spike_limited", changes)


def test_a_result_is_told_from_a_scene():
    with pytest.raises(SceneError, match=r"is a result, not a scene; `wormopt show`"):
        load_scene(SAVED / "fit_pair.nc")


# What a scene may hold anywhere, the worst included.
VALUES = st.recursive(
    st.sampled_from(
        'nan inf -inf true "" "speed" "fast" "λ" "\\u0000" 1e308 1e-308 -0.0 0 1 -1 2.5 [] {} '
        "1979-05-27 1180591620717411303424".split()
    ),
    lambda inner: st.lists(inner, max_size=4).map(lambda items: f"[{', '.join(items)}]"),
    max_leaves=6,
)
KEYS = {
    "design gait fast file pareto material swinging": """
        schema kind title units want worm gait search objective pareto worm.links worm.mass
        worm.drag worm.load gait.period gait.length gait.resting gait.rate
        gait.rate.contraction gait.acceleration gait.spike_load gait.impulses gait.shape
        gait.profile gait.ramp gait.file objective.minimise objective.speed search.sequence
        search.seed search.phases pareto.points material material.field material.mu_r
        material.lame_eta material.u0 material.youngs_modulus_eff sample strain worm.masses
        worm.harmonic worm.harmonic.0.phase worm.harmonic.0.amplitude worm.harmonic.0.order
        worm.friction worm.frequency time.periods
    """,
    "track random simulate model": """
        worm worm.links worm.mass worm.stiffness worm.friction worm.friction.kind
        worm.random worm.friction.forward worm.random.seed worm.random.stiffness start
        start.position reference reference.gait reference.gait.shape reference.shift tracker
        tracker.feedback tracker.growth tracker.adaptation tracker.feedforward
        tracker.tube_radius contact contact.treatment contact.v_reg time time.end
        time.samples tolerance tolerance.relative ensemble want ensemble.members actuation
        actuation.law model model.file model.parameters model.parameters.rate
    """,
}


@pytest.mark.parametrize("names", KEYS)
@settings(max_examples=examples(300))
@given(data=st.data())
def test_any_scene_is_read_or_refused(tmp_path_factory: Folders, names: str, data: st.DataObject):
    text = getattr(by_text, data.draw(st.sampled_from(names.split())).upper())
    change = st.builds("{}={}".format, st.sampled_from(KEYS[names].split()), VALUES)
    path = write(tmp_path_factory.mktemp("scene"), text)
    try:
        scene = load_scene(path, data.draw(st.lists(change, max_size=3)))
    except SceneError as error:
        for line in str(error).splitlines():
            assert line.startswith(f"{path}: ")
    else:
        assert "NaN" not in scene.text
        assert "Infinity" not in scene.text


@given(content=st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_any_file_is_refused(tmp_path_factory: Folders, content: bytes):
    path = write(tmp_path_factory.mktemp("scene"), content)
    with pytest.raises(SceneError, match=r"scene\.toml"):
        load_scene(path)
