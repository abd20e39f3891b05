"""Mode sequences, and the ceiling of the mode linear program against values known exactly."""

from collections.abc import Iterable
from fractions import Fraction
from itertools import combinations, pairwise

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse
from scipy.optimize import linprog

from wormopt.model.modes import ModeSequence
from wormopt.systems.spiked.construct import block_wave
from wormopt.systems.spiked.crawl import crawl
from wormopt.systems.spiked.search.orders import best_modes, ceiling

# Ceiling over r by links and resting masses (theory of the corrected chapter, section 1).
TABLE = {
    1: ["1/2"],
    2: ["1", "1/3"],
    3: ["3/2", "2/3", "1/4"],
    4: ["2", "1", "1/2", "1/5"],
    5: ["5/2", "3/2", "5/6", "2/5", "1/6"],
    6: ["3", "2", "7/6", "9/13", "1/3", "1/7"],
    7: ["7/2", "5/2", "3/2", "1", "33/56", "2/7", "1/8"],
    8: ["4", "3", "2", "4/3", "5/6", "18/35", "1/4", "1/9"],
}
CASES = [(n, a, Fraction(v)) for n, row in TABLE.items() for a, v in enumerate(row, start=1)]


@pytest.mark.parametrize(("links", "resting", "value"), CASES)
def test_the_ceiling_has_its_known_values(links: int, resting: int, value: Fraction):
    limits = [1.0] * links
    assert ceiling(limits, limits, resting) == pytest.approx(value, rel=1e-9)


@given(contraction=st.floats(0.01, 100), extension=st.floats(0.01, 100))
def test_one_link_with_two_rates(contraction: float, extension: float):
    """A stroke takes 1/c + 1/e, so the speed is c e / (c + e)."""
    exact = contraction * extension / (contraction + extension)
    assert ceiling([contraction], [extension], 1) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("links", [2, 3])
def test_the_accordion_with_two_rates_is_the_best(links: int):
    """All links alike and a = 1: n c e / (c + e), as for one link n times as long."""
    contraction, extension = 0.5, 2.0
    exact = links * contraction * extension / (contraction + extension)
    found = ceiling([contraction] * links, [extension] * links, 1)
    assert found == pytest.approx(exact, rel=1e-9)


def listed(contraction: list[float], extension: list[float], sets: list) -> float:
    """Solve the mode linear program as it is stated, with columns for every listed set.

    Per mode the share of time, then the distance of every mass.
    """
    n, scale = len(contraction), max(contraction + extension)
    change = np.eye(n, n + 2, 1) - np.eye(n, n + 2, 2)  # lengthening of a link over the mode
    too_long, too_short = change.copy(), -change
    too_long[:, 0] = -np.array(extension) / scale
    too_short[:, 0] = -np.array(contraction) / scale
    upper = np.full((len(sets), n + 2), np.inf)
    for row, mode in zip(upper, sets, strict=True):
        row[[i + 1 for i in mode]] = 0.0
    sums = np.vstack([np.eye(1, n + 2), change])
    answer = linprog(
        np.tile(-np.eye(1, n + 2, 1), len(sets)).ravel(),
        A_ub=sparse.kron(
            sparse.eye_array(len(sets)), np.vstack([too_long, too_short]), format="csr"
        ),
        b_ub=np.zeros(2 * n * len(sets)),
        A_eq=np.tile(sums, len(sets)),
        b_eq=np.eye(n + 1)[0],
        bounds=np.column_stack([np.zeros(upper.size), upper.ravel()]),
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    assert answer.status == 0
    return -answer.fun * scale


def all_sets(links: int, least: int) -> list[tuple[int, ...]]:
    masses = range(links + 1)
    return [s for size in range(least, links + 2) for s in combinations(masses, size)]


@settings(max_examples=examples(40))
@given(data=st.data(), links=st.integers(1, 6))
def test_the_ceiling_is_that_of_all_sets_listed(data: st.DataObject, links: int):
    rates = st.lists(st.floats(0.05, 3), min_size=links, max_size=links)
    contraction, extension = data.draw(rates), data.draw(rates)
    resting = data.draw(st.integers(1, links))
    exact = listed(contraction, extension, list(combinations(range(links + 1), resting)))
    assert ceiling(contraction, extension, resting) == pytest.approx(exact, rel=1e-9)
    some = data.draw(st.lists(st.sampled_from(all_sets(links, 1)), min_size=1, max_size=8))
    exact = listed(contraction, extension, some)
    assert ceiling(contraction, extension, 1, some) == pytest.approx(exact, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("resting", range(1, 9))
def test_the_ceiling_of_eight_links_is_that_of_all_sets_listed(resting: int):
    contraction, extension = np.random.default_rng(resting).uniform(0.2, 2.0, (2, 8)).tolist()
    exact = listed(contraction, extension, list(combinations(range(9), resting)))
    assert ceiling(contraction, extension, resting) == pytest.approx(exact, rel=1e-9)


@settings(max_examples=examples(20))
@given(data=st.data(), links=st.integers(1, 12), factor=st.floats(1e-6, 1e6))
def test_the_ceiling_scales_mirrors_and_falls_with_resting_masses(
    data: st.DataObject, links: int, factor: float
):
    rates = st.lists(st.floats(0.01, 10), min_size=links, max_size=links)
    contraction, extension = data.draw(rates), data.draw(rates)
    values = [ceiling(contraction, extension, a) for a in range(1, links + 1)]
    assert all(more <= less * (1 + 1e-9) for less, more in pairwise(values))
    resting = data.draw(st.integers(1, links))
    scaled = ceiling([factor * c for c in contraction], [factor * e for e in extension], resting)
    assert scaled == pytest.approx(factor * values[resting - 1], rel=1e-9)
    # Time reversed and seen from behind it crawls as well: links in reverse, rates swapped.
    mirrored = ceiling(extension[::-1], contraction[::-1], resting)
    assert mirrored == pytest.approx(values[resting - 1], rel=1e-9)


def fastest_segment(weights: np.ndarray, contraction: np.ndarray, extension: np.ndarray) -> float:
    """Largest weighted sum of velocities between two masses at rest; ends without one are inf."""
    n = len(weights)
    if n == 0:
        return 0.0
    to_ahead, to_behind = np.eye(n + 1, n, -1), np.eye(n + 1, n)
    lengthening = to_ahead - to_behind
    inner = np.isfinite(contraction)
    b_ub = np.concatenate([extension[inner], contraction[inner]])
    answer = linprog(-weights, A_ub=np.vstack([lengthening[inner], -lengthening[inner]]), b_ub=b_ub)
    assert answer.status == 0
    return -answer.fun


def bound_of_weights(
    weights: np.ndarray, contraction: np.ndarray, extension: np.ndarray, resting: int
) -> float:
    """Largest weighted sum of velocities with so many masses at rest, for weights of sum 1.

    All masses advance alike in a period, so it is an upper bound on the mean speed. Linear
    programs between masses at rest, then the best positions of 1, 2, ... of them.
    """
    n = len(contraction)
    c, e = (np.concatenate([[np.inf], r, [np.inf]]) for r in (contraction, extension))

    def between(ahead: int, behind: int) -> float:
        links = slice(ahead + 1, behind + 1)
        return fastest_segment(weights[ahead + 1 : behind], c[links], e[links])

    best = {i: between(-1, i) for i in range(n + 1)}
    inside = {(i, k): between(i, k) for i, k in combinations(range(n + 1), 2)}
    for _ in range(resting - 1):
        best = {
            k: max((best[i] + inside[i, k] for i in best if i < k), default=-np.inf)
            for k in range(n + 1)
        }
    return max(value + between(i, n + 1) for i, value in best.items())


@pytest.mark.parametrize(
    ("links", "resting"),
    [
        (6, 2),
        (8, 1),
        (16, 9),
        *(pytest.param(*n, marks=pytest.mark.slow) for n in ((16, 1), (32, 8), (32, 30))),
    ],
)
@pytest.mark.parametrize("equal", [True, False], ids=["equal", "unequal"])
def test_a_mix_of_modes_reaches_the_ceiling_that_its_weights_prove(
    links: int, resting: int, equal: bool
):
    """Primal and dual, both checked here: the mix is a motion, the weights bound all motions."""
    rates = np.random.default_rng(links + resting).uniform(0.3, 1.5, (2, links))
    contraction, extension = np.ones((2, links)) if equal else rates
    (mix,) = best_modes(contraction.tolist(), extension.tolist(), resting)
    shares, velocities = np.array(mix.shares), np.array(mix.velocities)
    assert shares.sum() == pytest.approx(1, rel=1e-9)
    assert shares.min() > 0
    assert len(set(mix.sets)) == len(mix.sets) <= links + 2
    for z, v in zip(mix.sets, velocities, strict=True):
        assert len(z) == resting
        assert v[list(z)] == pytest.approx(0, abs=1e-9)
    assert velocities.min() > -1e-9
    lengthening = velocities[:, :-1] - velocities[:, 1:]
    assert (lengthening <= extension + 1e-9).all()
    assert (lengthening >= -contraction - 1e-9).all()
    assert shares @ velocities == pytest.approx(mix.speed, rel=1e-9)
    weights = np.array(mix.weights)
    assert weights.sum() == pytest.approx(1, rel=1e-12)
    proven = bound_of_weights(weights, contraction, extension, resting)
    assert mix.ceiling == pytest.approx(proven, rel=1e-9)
    assert mix.speed == pytest.approx(proven, rel=2e-8)
    slowest = min(*contraction, *extension)  # block-rest wave, accordion
    assert mix.ceiling >= slowest * (links + 1 - resting) / (links + 1) * (1 - 1e-9)
    if resting == 1:
        assert mix.ceiling >= links * slowest / 2 * (1 - 1e-9)


# Closed forms for rates of 1: a mix of modes reaches the value, weights of the masses prove it.
Mix = list[tuple[Fraction, list[Fraction]]]
Proof = tuple[Fraction, Mix, list[Fraction]]


def weights_at(n: int, *places: int) -> list[Fraction]:
    """Equal weights at places and their mirror images, with sum 1."""
    both = [*places, *(n - i for i in places)]
    return [Fraction(both.count(i), len(both)) for i in range(n + 1)]


def two_blocks(n: int, a: int) -> Proof:
    """The head block of a masses rests, then the tail block: an accordion between two blocks."""
    span = n - 2 * a + 2
    behind = [Fraction(min(max(i - a + 1, 0), span)) for i in range(n + 1)]
    half = Fraction(1, 2)
    return Fraction(span, 2), [(half, behind), (half, behind[::-1])], weights_at(n, a - 1)


def split_block(n: int, a: int) -> Proof:
    """Head block, tail block, and a block split between both ends, for a third of time each."""
    value = Fraction(2 * n + 4 - 3 * a, 6)
    behind = [min(Fraction(max(i - a + 1, 0)), 3 * value) for i in range(n + 1)]
    mix = [(Fraction(1, 3), behind), (Fraction(1, 3), behind[::-1])]
    for ahead in (a // 2, a - a // 2):
        apart = [
            min(i - ahead + 1, n - (a - ahead) + 1 - i, a - ahead if i < a else ahead)
            for i in range(n + 1)
        ]
        mix.append((Fraction(1, 6), [Fraction(max(v, 0)) for v in apart]))
    outer = 3 * a - n - 2
    return value, mix, weights_at(n, a - 1, a - 1 - outer // 2, a - 1 - (outer + 1) // 2)


def moving_pair(n: int, a: int) -> Proof:
    """Two neighbours move at a time, pair after pair; at the ends the last mass moves twice."""
    mix: Mix = []
    for i in range(n):
        pair = [Fraction(k in (i, i + 1)) for k in range(n + 1)]
        for end in (0, n):
            pair[end] *= 2
        mix.append((Fraction(1, n), pair))
    weights = [Fraction(1, n if 0 < i < n else 2 * n) for i in range(n + 1)]
    return Fraction(2, n), mix, weights


def hopping(n: int, a: int) -> Proof:
    """One mass moves at a time."""
    share = Fraction(1, n + 1)
    return (
        share,
        [(share, [Fraction(i == k) for i in range(n + 1)]) for k in range(n + 1)],
        [share] * (n + 1),
    )


CLOSED = [
    *[(two_blocks, n, a) for n in range(1, 11) for a in range(1, n + 1) if 3 * a <= n + 2],
    *[
        (split_block, n, a)
        for n in range(1, 11)
        for a in range(1, n + 1)
        if n + 2 <= 3 * a and 2 * a <= n + 1
    ],
    *[(moving_pair, n, n - 1) for n in range(2, 11)],
    *[(hopping, n, n) for n in range(1, 11)],
]


@pytest.mark.parametrize(("form", "links", "resting"), CLOSED)
def test_closed_forms_of_the_ceiling(form, links: int, resting: int):
    """In exact arithmetic, with all sets tried: no velocity exceeds the distance to rest."""
    value, mix, weights = form(links, resting)
    assert sum(share for share, _ in mix) == sum(weights) == 1
    for _, velocities in mix:
        assert velocities.count(Fraction(0)) >= resting
        assert min(velocities) >= 0
        assert all(abs(ahead - behind) <= 1 for ahead, behind in pairwise(velocities))
    for i in range(links + 1):
        assert sum(share * velocities[i] for share, velocities in mix) == value
    heavy = [(i, weight) for i, weight in enumerate(weights) if weight]
    assert value == max(
        sum(weight * min(abs(i - k) for k in z) for i, weight in heavy)
        for z in combinations(range(links + 1), resting)
    )
    assert ceiling([1.0] * links, [1.0] * links, resting) == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("links", [16, 25, 32])
def test_closed_forms_of_long_worms(links: int):
    def value(a: int) -> float:
        return ceiling([1.0] * links, [1.0] * links, a)

    a = (links + 2) // 3
    assert value(a) == pytest.approx(links / 2 - a + 1, rel=1e-9)
    a = (links + 1) // 2
    assert value(a) == pytest.approx((links + 2) / 3 - a / 2, rel=1e-9)
    assert value(links - 1) == pytest.approx(2 / links, rel=1e-9)
    fitted = (  # no proof is known
        12 * (3 * links - 10) / (9 * links**2 - 32 * links + 7)
        if links % 2
        else 36 / (9 * links - 2)
    )
    assert value(links - 2) == pytest.approx(fitted, rel=1e-9)


# Fewest sets of an optimum by links and resting masses, from a mixed-integer program over all
# sets outside this package.
FEWEST = {
    4: [2, 2, 4, 5],
    5: [2, 2, 4, 4, 6],
    6: [2, 2, 4, 6, 5, 7],
    7: [2, 2, 2, 3, 8, 5, 8],
    8: [2, 2, 2, 3, 5, 9, 6, 9],
}


@pytest.mark.parametrize(
    "links", [4, 5, *(pytest.param(n, marks=pytest.mark.slow) for n in (6, 7, 8))]
)
def test_mixes_of_fewest_sets_are_found(links: int):
    for resting, fewest in enumerate(FEWEST[links], start=1):
        mixes = best_modes([1.0] * links, [1.0] * links, resting, count=10)
        assert len(mixes[0].sets) == fewest
        assert len({mix.sets for mix in mixes}) == len(mixes)
        for mix in mixes:
            assert listed([1.0] * links, [1.0] * links, list(mix.sets)) == pytest.approx(
                mix.ceiling, rel=2e-8
            )


@pytest.mark.parametrize("links", [2, 13, pytest.param(32, marks=pytest.mark.slow)])
@pytest.mark.parametrize("ratio", [1e-5, 1e-14])
def test_a_link_that_hardly_moves_does_not_spoil_the_bound(links: int, ratio: float):
    """It joins two masses into one, up to what it moves itself."""
    rates = np.random.default_rng(links).uniform(0.5, 1.5, (2, links))
    stiff = rates.copy()
    stiff[:, links // 2] = ratio
    contraction, extension = np.delete(rates, links // 2, axis=1).tolist()
    joined = ceiling(contraction, extension, 1)
    contraction, extension = stiff.tolist()
    bound = ceiling(contraction, extension, 1)
    assert joined * (1 - 1e-9) <= bound <= joined + links * max(ratio, 2e-6)


@settings(max_examples=examples(25))
@given(data=st.data(), links=st.integers(1, 5), stroke=st.floats(0.05, 1))
def test_no_block_wave_passes_the_ceiling_of_its_own_rates(
    data: st.DataObject, links: int, stroke: float
):
    resting = data.draw(st.integers(1, links))
    gait = block_wave(links, resting, 1.0, (1.0, 1.0 + stroke), "trapezoid", ramp=0.0)
    motion = crawl(gait, [1.0] * (links + 1), 0.0, 10.0)
    rate = stroke * (links + 1)
    bound = ceiling([rate] * links, [rate] * links, resting)
    assert motion.speed <= bound * (1 + 1e-9)
    if resting == links:  # one mass hops at a time: the wave is all there is
        assert motion.speed == pytest.approx(bound, rel=1e-9)


@pytest.mark.parametrize(
    "sets", [[[0]], [[0], [0]], [[0, 2]], [[0, 1, 2]]], ids=["head", "twice", "ends", "all"]
)
def test_a_mass_that_always_rests_forbids_to_advance(sets: list[Iterable[int]]):
    assert ceiling([1.0, 1.0], [1.0, 1.0], 1, sets) == pytest.approx(0, abs=1e-12)


def test_head_then_tail_alone_is_enough_under_rate_limits():
    """The accordion: limits beyond rates are what makes a third mode worth its while."""
    assert ceiling([1.0] * 2, [1.0] * 2, 1, [{0}, {2}]) == pytest.approx(1.0, rel=1e-9)
    assert ceiling([1.0] * 2, [1.0] * 2, 1, [{0}, {1}]) == pytest.approx(0.5, rel=1e-9)


@given(contacts=st.integers(1, 8), data=st.data())
def test_resting_sets_come_back_from_a_sequence(contacts: int, data: st.DataObject):
    phase = st.frozensets(st.integers(0, contacts - 1))
    sets = data.draw(st.lists(phase, min_size=1, max_size=6))
    sequence = ModeSequence.of_resting(sets, contacts)
    assert sequence.resting == tuple(tuple(sorted(s)) for s in sets)
    assert sequence.states.shape == (len(sets), contacts)
    assert np.array_equal(sequence.states == 0, [[i in s for i in range(contacts)] for s in sets])
    assert sequence == ModeSequence(sequence.phases)


@pytest.mark.parametrize("phases", [(), ((0, 1), (0, 1, 1))])
def test_sequences_without_a_common_set_of_contacts_are_refused(phases: tuple):
    with pytest.raises(ValueError, match="phases must"):
        ModeSequence(phases)


@pytest.mark.parametrize("phase", [{3}, {-1}, {0, 7}])
def test_a_resting_contact_that_does_not_exist_is_refused(phase: set[int]):
    with pytest.raises(ValueError, match="contacts"):
        ModeSequence.of_resting([{0}, phase], 3)


@pytest.mark.parametrize("state", [2, -2])
def test_a_state_that_is_none_is_refused(state: int):
    with pytest.raises(ValueError, match="0, \\+1 or -1"):
        ModeSequence(((0, 1), (state, 0)))
