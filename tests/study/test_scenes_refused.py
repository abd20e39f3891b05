"""What scenes of the kinds "track" and "simulate" refuse, and what they say about it."""

from pathlib import Path

import hypothesis.strategies as st
import pytest
from effort import examples
from hypothesis import given, settings

import wormopt as wo
from tests.oracles.by_text import MODEL, OWN, RANDOM, SIMULATE, TRACK, write
from wormopt.cli import main
from wormopt.errors import SceneError
from wormopt.study import load_scene

# Base scene, change as for --set, key path and part of the message.
HOSTILE = [
    (TRACK, "worm.links=0", "worm.links", "from 1 to 100"),
    (TRACK, "worm.links=101", "worm.links", "from 1 to 100"),
    (TRACK, "worm.links=3", "reference.gait.shape", "2 links"),
    (TRACK, "worm.mass=0", "worm.mass", "above 0"),
    (TRACK, "worm.mass=[1, 1]", "worm.mass", "2 entries for 3 masses"),
    (TRACK, "worm.stiffness=-1", "worm.stiffness", "0 or above"),
    (TRACK, "worm.mass=1e-40", "worm.mass", "1e-40 is too small to compute with"),
    (TRACK, "worm.mass=1e40", "worm.mass", "1e+40 is too large to compute with"),
    (TRACK, "worm.mass=[1, 1]", "worm.mass", "one number for all masses, or a list of 3"),
    (
        TRACK,
        'worm.friction=[{kind="spike"}, {kind="spike"}]',
        "worm.friction",
        "2 entries for 3 masses; write one table for all masses, or a list of 3",
    ),
    (TRACK, "worm.damping=[1, 2, 3]", "worm.damping", "3 entries for 2 links"),
    (TRACK, "worm.rest_length=nan", "worm.rest_length", "finite"),
    (TRACK, "worm.drag=[1, 2]", "worm.drag", "2 entries for 3 masses"),
    (TRACK, "worm.load=inf", "worm.load", "finite"),
    (TRACK, "worm.frction=3", "worm.frction", "did you mean friction"),
    (TRACK, "worm.mass=1e40", "worm.mass", "choose units"),
    (TRACK, "worm.mass=[1, 1e-40, 1]", "worm.mass[1]", "choose units"),
    (SIMULATE, "worm.friction.forward=1e300", "worm.friction.forward", "choose units"),
    (TRACK, "tracker=3", "tracker", 'a table with feedback = "filter", "derivative", '),
    (TRACK, "tracker=3", "tracker", 'or "funnel", or a list of such'),
    (TRACK, 'tracker.input="spring"', "tracker.input", '"force" or "rest_length"'),
    # friction
    (TRACK, "worm.friction=3", "worm.friction", "a table"),
    (TRACK, 'worm.friction={kind="dry"}', "worm.friction.kind", '"coulomb", "stribeck"'),
    (TRACK, "worm.friction={forward=1}", "worm.friction.kind", "missing"),
    (TRACK, "worm.friction.forward=-1", "worm.friction.forward", "0 or above"),
    (TRACK, "worm.friction.forward=[1, 1]", "worm.friction.forward", "2 entries for 3 masses"),
    (TRACK, "worm.friction.stick_forward=0.5", "worm.friction.stick_forward", "below the sliding"),
    (TRACK, "worm.friction.drag=1", "worm.friction.drag", 'with kind = "coulomb"'),
    (TRACK, 'worm.friction={kind="viscous"}', "worm.friction.drag", "missing"),
    (
        TRACK,
        'worm.friction={kind="stribeck", forward=1, backward=1, stick_forward=2, stick_backward=2,'
        " v_stribeck=0}",
        "worm.friction.v_stribeck",
        "above 0",
    ),
    (TRACK, 'worm.friction={kind="spike", scale=0}', "worm.friction.scale", "above 0"),
    (TRACK, 'worm.friction=[{kind="spike"}]', "worm.friction", "1 entry for 3 masses"),
    (
        TRACK,
        'worm.friction=[{kind="spike"}, {kind="spike"}, {kind="spikes"}]',
        "worm.friction[2].kind",
        '"spikes" is not allowed',
    ),
    (
        TRACK,
        'worm.friction=[{kind="spike"}, {kind="spike"}, {kind="viscous", drag=[1, 1, 1]}]',
        "worm.friction[2].drag",
        "for one mass",
    ),
    # chance
    (TRACK, "worm.random={}", "worm.random", "contains nothing random"),
    (TRACK, "worm.random.seed=-1", "worm.random.seed", "a whole number from 0"),
    (TRACK, "worm.random.stiffness=3", "worm.random.stiffness", "a table"),
    (
        TRACK,
        'worm.random.stiffness={process="noise"}',
        "worm.random.stiffness.process",
        '"fixed", "steps" or "ornstein_uhlenbeck"',
    ),
    (
        TRACK,
        'worm.random.stiffness={process="fixed", spread=10}',
        "worm.random.stiffness.spread",
        "not below worm.stiffness",
    ),
    (
        TRACK,
        'worm.random.damping={process="fixed", spread=[1, 1, 1]}',
        "worm.random.damping.spread",
        "3 entries for 2 links",
    ),
    (
        TRACK,
        'worm.random.damping={process="steps", spread=1, interval=1e-9}',
        "worm.random.damping.interval",
        "more than 1000000 pieces",
    ),
    # start, reference
    (TRACK, "start.position=[1, 2]", "start.position", "2 entries for 3 masses"),
    (TRACK, "start.velocity=[1, 2]", "start.velocity", "2 entries for 3 masses"),
    (TRACK, "reference=3", "reference", "a table"),
    (TRACK, "reference={}", "reference.gait", "missing"),
    (TRACK, "reference.shift=nan", "reference.shift", "finite"),
    (TRACK, 'reference.gait.shape="cosine"', "reference.gait.shape", '"sine"'),
    (TRACK, 'reference.gait.sharing="equal"', "reference.gait.sharing", "unknown key"),
    (TRACK, 'reference.gait={shape="sine", period=1, amplitude=0}', "reference.gait.amplitude", ""),
    (TRACK, 'reference.gait={shape="file", file="no.csv"}', "reference.gait.file", "cannot be"),
    (
        TRACK,
        'reference.gait={shape="block_wave", period=1, length=[2, 1]}',
        "reference.gait.length",
        "empty",
    ),
    # trackers
    (TRACK, "tracker=[]", "tracker", "at least one"),
    (TRACK, "tracker=3", "tracker", "a table"),
    (TRACK, "tracker=[3]", "tracker[0]", "a table"),
    (TRACK, 'tracker.feedback="pid"', "tracker.feedback", '"filter", "derivative"'),
    (TRACK, 'tracker=[{feedback="pid"}]', "tracker[0].feedback", '"pid" is not allowed'),
    (TRACK, 'tracker=[{feedback="filter"}]', "tracker[0].tube_radius", "missing"),
    (TRACK, "tracker.tube_radius=0", "tracker.tube_radius", "above 0"),
    (TRACK, "tracker.gain_start=0", "tracker.gain_start", "above 0"),
    (TRACK, "tracker.growth=0", "tracker.growth", "above 0"),
    (TRACK, "tracker.filter_start=1", "tracker.filter_start", 'with feedback = "derivative"'),
    (
        TRACK,
        'tracker={feedback="filter", tube_radius=1, filter_start=[1, 2, 3]}',
        "tracker.filter_start",
        "3 entries for 2 links",
    ),
    (TRACK, "tracker.adaptation={}", "tracker.adaptation.law", "missing"),
    (
        TRACK,
        'tracker.adaptation={law="exponent", exponent=0}',
        "tracker.adaptation.exponent",
        "from 1 to 100",
    ),
    (TRACK, "tracker.feedforward=true", "tracker.feedforward", "a table"),
    (
        TRACK,
        "tracker.feedforward.stiffness=[1]",
        "tracker.feedforward.stiffness",
        "1 entry for 2 links",
    ),
    (TRACK, 'tracker={feedback="funnel"}', "tracker.funnel", "missing"),
    (TRACK, 'tracker.feedback="difference"', "tracker.lag", "missing"),
    (TRACK, 'tracker={feedback="difference", lag=0, tube_radius=1}', "tracker.lag", "above 0"),
    (
        TRACK,
        'tracker={feedback="difference", lag=1e-7, tube_radius=1}',
        "tracker.lag",
        "2e+07 stretches; write 2e-05 or more",
    ),
    (TRACK, 'tracker={feedback="switching"}', "tracker.settling", "missing"),
    (
        TRACK,
        'tracker={feedback="switching", tube_radius=1, settling=1, overshoot=1, factor=1}',
        "tracker.factor",
        "from 1.01 to 100",
    ),
    (
        TRACK,
        'tracker={feedback="switching", tube_radius=1, settling=1, overshoot=1, filter_start=[1]}',
        "tracker.filter_start",
        "1 entry for 2 links",
    ),
    (TRACK, 'tracker={feedback="backstepping"}', "tracker.tube_radius", "missing"),
    (
        TRACK,
        'tracker={feedback="funnel", law="three gains", funnel={start=1, end=1, time=1}, '
        "rate_funnel={start=1, end=1, time=1}}",
        "tracker.law",
        '"recursive" or "two gains"',
    ),
    # the rest
    (TRACK, 'contact.treatment="rough"', "contact.treatment", '"smooth" or "exact"'),
    (TRACK, 'contact={treatment="smooth", v_reg=0}', "contact.v_reg", "above 0"),
    (TRACK, 'contact={treatment="exact", v_reg=1}', "contact.v_reg", "unknown key"),
    (TRACK, "time.end=0", "time.end", "above 0"),
    (TRACK, "time.samples=1", "time.samples", "from 2"),
    (TRACK, "tolerance.relative=1e-15", "tolerance.relative", "1e-14"),
    (TRACK, "tolerance.absolute=0", "tolerance.absolute", "above 0"),
    (TRACK, "tolerance.max_steps=0", "tolerance.max_steps", "from 1 to"),
    (TRACK, "tolerance.recheck=1", "tolerance.recheck", "true or false"),
    (TRACK, "ensemble.members=1", "ensemble.members", "from 2"),
    (TRACK, "ensemble.members=5", "ensemble", "would have equal members"),
    (TRACK, 'want=["bands"]', "want", "needs an ensemble"),
    (RANDOM, 'want=["motion"]', "want", 'write "bands"'),
    (TRACK, 'want=["spikes"]', "want[0]", '"trackers"'),
    # kind simulate
    (SIMULATE, 'model="a.py:build"', "model", "both"),
    (SIMULATE, "parameters.a=1", "parameters", "to a model only"),
    (SIMULATE, 'actuation.law="step"', "actuation.law", '"constant", "harmonic" or "gait"'),
    (SIMULATE, 'actuation={law="constant", force=[1]}', "actuation.force", "1 entry for 2 links"),
    (SIMULATE, 'actuation={law="harmonic", amplitude=1}', "actuation.period", "missing"),
    (
        SIMULATE,
        'actuation={law="harmonic", amplitude=[1, 2, 3], period=1}',
        "actuation.amplitude",
        "3 entries for 2 links",
    ),
    (SIMULATE, 'actuation={law="gait"}', "actuation.gait", "missing"),
    (
        SIMULATE,
        'actuation={law="gait", gait={shape="file", file="no.csv"}}',
        "actuation.gait.file",
        "cannot be read",
    ),
    (SIMULATE, 'want=["trackers"]', "want[0]", '"motion"'),
    (SIMULATE, 'tracker={feedback="filter"}', "tracker", "unknown key"),
    (MODEL, 'model="own.py"', "model", '"file.py:function"'),
    (MODEL, 'model="own.txt:build"', "model", '"file.py:function"'),
    (MODEL, 'model="own.py:a b"', "model", '"file.py:function"'),
    (MODEL, 'model="none.py:build"', "model", "cannot be read"),
    (MODEL, 'model="folder.py:build"', "model", "cannot be read"),
    (MODEL, 'model="broken.py:build"', "model", "broken.py line 2"),
    (MODEL, 'model="null.py:build"', "model", "null.py"),
    (MODEL, "start.velocity=1", "start", "applies to [worm]"),
    (MODEL, 'actuation={law="constant", force=1}', "actuation", "applies to [worm]"),
    (MODEL, 'want=["motion"]', "want", '"signals"'),
    (MODEL, "parameters.rate=nan", "parameters.rate", "finite"),
    (MODEL, "parameters.rate=[1, inf]", "parameters.rate", "finite"),
    (MODEL, "parameters.rate=1979-05-27", "parameters.rate", "finite"),
    (MODEL, "parameters=3", "parameters", "a table"),
]

# What may be wrong with the user's file once it runs: text, key path, part of the message.
HOSTILE_MODELS = [
    ("x = 1 / 0", "model", "own.py line 1: ZeroDivisionError: division by zero"),
    ("import no_such_module_at_all", "model", "line 1: ModuleNotFoundError"),
    ("import sys\nsys.exit(3)", "model", "line 2: SystemExit: 3"),
    ("", "model", "no function build; define it"),
    ("def biuld(): pass", "model", 'write model = "own.py:biuld"'),
    ("build = 3", "model", "no function build"),
    ("def build():\n    return None", "model", "returns nothing, not a Model"),
    ("def build():\n    return {}", "model", "returns dict, not a Model"),
    (
        "def build():\n    pass\n    raise ValueError('no legs')",
        "model",
        "line 3: ValueError: no legs",
    ),
    ("def build(a):\n    return None", "parameters.a", "missing"),
    (OWN.replace("value=1.0", "value=(1.0, 2.0)"), "model", "value of x has 1 entry, not 2"),
    (OWN.replace('"x", x', '"time", x'), "model", "'time' is already used"),
    (OWN.replace('"x", x', '"x 1", x'), "model", "is not a valid name"),
    (OWN.replace("ode=-rate * x", 'ode=-ca.SX.sym("c") * x'), "model", ": c; give them"),
    (OWN.replace("ca.SX", "ca.MX"), "model", "of CasADi's SX symbols"),
    (
        OWN.replace("value=1.0", 'value=1.0, unit="lenght"'),
        "model",
        "the unit of 'x' is 'lenght'; did you mean 'length'?",
    ),
    (OWN.replace("value=1.0", "value=1.0, unit=3"), "model", "the unit of 'x' is 3; write"),
    (OWN.replace("ode=-rate * x", "ode=ca.SX(2, 1)"), "model", "line 6: ArgumentError"),
    (
        OWN.replace("[Signal", "[] and [Signal").replace("-rate * x", "ca.SX(0, 1)"),
        "model",
        "no st",
    ),
]


@pytest.mark.parametrize(("text", "change", "key", "message"), HOSTILE)
def test_a_wrong_scene_is_refused_with_file_and_key(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    change: str,
    key: str,
    message: str,
):
    path = write(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load_scene(path, [change])
    assert any(key == found and message in said for found, said in caught.value.faults), caught
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--set", change]) == 2
    assert f"{path}: {key}: " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("own", "key", "message"), HOSTILE_MODELS)
def test_a_wrong_model_is_refused_with_file_and_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], own: str, key: str, message: str
):
    path = write(tmp_path, MODEL, own)
    assert main(["check", str(path)]) == 0  # checking runs nothing
    capsys.readouterr()
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"{path}: {key}: ")
    assert message in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_wrong_parameters_of_a_model_are_named(tmp_path: Path):
    path = write(tmp_path, MODEL)
    with pytest.raises(SceneError, match=r"parameters\.raet: .*did you mean rate"):
        wo.run(load_scene(path, ["parameters.raet=2"]))


@pytest.mark.parametrize(
    ("body", "given", "key", "message"),
    [
        ("1 / rate", ["rate=0"], "parameters.rate", "own.py line 2: ZeroDivisionError"),
        ("1 / rate", ["rate=0", "size=2"], "parameters", "write other values, or correct the file"),
        ("assert size > 0, 'size: above 0'", ["rate=1", "size=0"], "parameters.size", "size: abo"),
    ],
)
def test_a_model_that_fails_with_given_parameters_names_their_key(
    tmp_path: Path, body: str, given: list[str], key: str, message: str
):
    path = write(tmp_path, MODEL, f"def build(rate=1, size=1):\n    {body}\n")
    with pytest.raises(SceneError) as caught:
        wo.run(load_scene(path, [f"parameters.{each}" for each in given]))
    ((found, said),) = caught.value.faults
    assert found == key
    assert message in said


def test_a_given_parameter_beyond_its_bounds_is_named(tmp_path: Path):
    own = OWN.replace("-rate * x)", "-r * x, p=[Signal('rate', r, lower=0, value=rate)])")
    own = own.replace("    x = ", '    r = ca.SX.sym("r")\n    x = ')
    path = write(tmp_path, MODEL, own)
    with pytest.raises(SceneError, match=r"parameters\.rate: .*rate must be 0 or above, not -2"):
        wo.run(load_scene(path, ["parameters.rate=-2"]))


def test_entries_of_lists_are_set_by_their_index(tmp_path: Path):
    path = write(tmp_path, TRACK.replace("[tracker]", "[[tracker]]"))
    changes = ["tracker.0.growth=7", "tracker[0].tube_radius=0.3", "start.position.1=2.5"]
    table = load_scene(path, changes).table
    assert (table.trackers[0].growth, table.trackers[0].tube_radius) == (7.0, 0.3)
    assert table.start.position == (4.0, 2.5, 0.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("start.position.3=1", r"start.position is a list; its entries are start.position.0 to 2"),
        ("start.position.x=1", r"start.position is a list; its entries are start.position.0 to 2"),
        ("worm.mass.0=1", r"worm.mass is not a table or list; give all of it: worm.mass=\[...\]"),
    ],
)
def test_entries_that_are_not_there_are_refused(tmp_path: Path, change: str, message: str):
    with pytest.raises(SceneError, match=message):
        load_scene(write(tmp_path, TRACK), [change])


def test_all_tables_of_a_list_are_checked_at_once(tmp_path: Path):
    text = 'tracker=[{feedback="filter", tube_radius=0}, {feedback="funnel", gain=-1}]'
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, TRACK), [text])
    assert {key for key, _ in caught.value.faults} == {
        "tracker[0].tube_radius",
        "tracker[1].gain",
        "tracker[1].funnel",
        "tracker[1].rate_funnel",
    }


# What a scene may hold anywhere, the worst included.
VALUES = st.recursive(
    st.sampled_from('nan inf -inf true "" "λ" "fast" 1e308 1e-308 -0.0 0 1 -1 2.5 [] {}'.split()),
    lambda inner: st.lists(inner, max_size=4).map(lambda items: f"[{', '.join(items)}]"),
    max_leaves=6,
)
KEYS = st.sampled_from(
    "worm worm.links worm.mass worm.stiffness worm.friction worm.friction.kind worm.random "
    "worm.friction.forward worm.random.seed worm.random.stiffness start start.position reference "
    "reference.gait reference.gait.shape reference.shift tracker tracker.feedback tracker.growth "
    "tracker.adaptation tracker.feedforward tracker.tube_radius contact contact.treatment "
    "contact.v_reg time time.end time.samples tolerance tolerance.relative ensemble want "
    "ensemble.members actuation actuation.law model parameters parameters.rate".split()
)


@settings(max_examples=examples(300))
@given(
    text=st.sampled_from([TRACK, RANDOM, SIMULATE, MODEL]),
    changes=st.lists(st.tuples(KEYS, VALUES), max_size=3),
)
def test_any_scene_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, text: str, changes: list[tuple[str, str]]
):
    path = write(tmp_path_factory.mktemp("scene"), text)
    try:
        scene = load_scene(path, [f"{key}={value}" for key, value in changes])
    except SceneError as error:
        for line in str(error).splitlines():
            assert line.startswith(f"{path}: ")
    else:
        assert "NaN" not in scene.text
        assert "Infinity" not in scene.text


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
    with pytest.raises(
        SceneError, match=r"gait.spike_load: .* the load of the worm, 15, .* than 5"
    ):
        load_scene("design_spike_limited", changes)
