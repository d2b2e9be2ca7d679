"""A million frames that a breaker must not act upon, and between them the trips that it must, once each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random

from faultloop.io.can.authentication import PLAIN, CmacSeal, Seal
from faultloop.io.can.frames import Frame, Heartbeat, Rejection, SampledValues, State, decode, ticks
from faultloop.io.can.table import OPERATIONAL, Kind
from faultloop.nodes import BreakerNode, Command, RelayNode
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.bus.residual import residual_checks, residual_table

MS = 1_000_000
SPACING_NS = 100_000
"""Between two frames of the fuzz: 10,000 a second, more than a bus at 1 Mbit/s carries."""
HALF_PERIOD_NS = 250 * MS
"""The genuine relay trips, resets, closes, resets: one step each."""
EPOCH_NS = 1_577_836_800_000_000_000
KEY, WRONG_KEY = bytes(range(16)), bytes(range(1, 17))
RELAY, STRANGER = 0, 5  # the breaker obeys the first, not the second


@dataclass(slots=True)
class World:
    """What a fuzzer may use: the clock, what has been on the bus, and what a genuine frame would be now."""

    random: Random
    authenticated: bool
    t_ns: int = 0
    recorded: list[Frame] = field(default_factory=list)
    newest: dict[int, State] = field(default_factory=dict)

    def seal(self, key: bytes, epoch_ns: int = EPOCH_NS) -> Seal:
        """A fresh one, as somebody with this key would make it."""
        if not self.authenticated:
            return PLAIN
        identifiers = [kind + n for kind in (Kind.TRIP, Kind.CLOSE, Kind.PILOT) for n in (RELAY, STRANGER)]
        return CmacSeal(dict.fromkeys(identifiers, key), epoch_ns)

    def next_state(self, kind: Kind) -> State:
        """The repetition that the genuine relay would send now."""
        last = self.newest[kind]
        return last._replace(
            sq_num=last.sq_num % 255 + 1, counter=(last.counter + 1) % 15, time=ticks(self.t_ns)
        )

    def command(self, kind: Kind) -> State:
        """The next state, all poles, right in every number."""
        last = self.newest[kind]
        return self.next_state(kind)._replace(st_num=last.st_num + 1 & 0xFF, sq_num=0, poles=last.poles ^ 7)

    def kind(self) -> Kind:
        return self.random.choice((Kind.TRIP, Kind.CLOSE))

    def fresh(self) -> Frame:
        """A good frame of the genuine relay's, sealed as it would be."""
        return self.seal(KEY).close(self.t_ns, self.next_state(self.kind()).encode())


def _random(w: World) -> Frame:
    extended = w.random.random() < 0.3
    fd = w.random.random() < 0.3
    length = w.random.choice((0, 8, 12, 16, 32, 64)) if fd else w.random.randrange(9)
    return Frame(w.random.getrandbits(29 if extended else 11), w.random.randbytes(length), extended, fd)


def _random_content(w: World) -> Frame:
    good = w.fresh()
    return good._replace(data=w.random.randbytes(len(good.data)))


def _flipped(w: World) -> Frame:
    good = w.fresh()
    bits = 8 * len(good.data)
    mask = sum(1 << bit for bit in w.random.sample(range(bits), w.random.randint(1, 8)))
    return good._replace(data=_xor(good.data, mask))


def _burst(w: World) -> Frame:
    good = w.fresh()
    mask = (w.random.getrandbits(8) | 1) << w.random.randrange(8 * len(good.data) - 7)
    return good._replace(data=_xor(good.data, mask))


def _xor(data: bytes, mask: int) -> bytes:
    # The order of transmission: bytes in order, the most significant bit of each first.
    return (int.from_bytes(data, "big") ^ mask).to_bytes(len(data), "big")


def _replayed(w: World) -> Frame:
    # Half of them young enough that their time alone does not tell.
    return w.random.choice(w.recorded if w.random.random() < 0.5 else w.recorded[-12:])


def _truncated(w: World) -> Frame:
    good = w.fresh()
    return good._replace(data=good.data[: w.random.randrange(len(good.data))])


def _lengthened(w: World) -> Frame:
    good = w.fresh()
    return good._replace(data=good.data + bytes(w.random.randint(1, 32)), fd=True)


def _other_format(w: World) -> Frame:
    good = w.fresh()
    return good._replace(extended=True) if w.random.random() < 0.5 else good._replace(fd=not good.fd)


def _other_identifier(w: World) -> Frame:
    good = w.fresh()
    return good._replace(id=good.id ^ (Kind.TRIP ^ Kind.CLOSE))  # a trip as a close, a close as a trip


def _command_at(w: World, offset_ns: int) -> Frame:
    t_ns = w.t_ns + offset_ns
    state = w.command(w.kind())._replace(time=ticks(t_ns))
    return w.seal(KEY).close(t_ns, state.encode())


def _stale(w: World) -> Frame:
    return _command_at(w, -w.random.randrange(1_000 * MS + 10_000, 20_000 * MS))


def _future(w: World) -> Frame:
    return _command_at(w, w.random.randrange(100 * MS + 20_000, 20_000 * MS))


def _under_test(w: World) -> Frame:
    return w.seal(KEY).close(w.t_ns, w.command(w.kind())._replace(test=True).encode())


def _for_others(w: World) -> Frame:
    other = w.command(w.kind())._replace(number=STRANGER)
    pilot = other._replace(kind=Kind.PILOT)
    samples = SampledValues(RELAY, 0, (0.0,) * 6)
    beat = Heartbeat(RELAY, OPERATIONAL, 0, 0, ticks(w.t_ns))
    return w.random.choice((other, pilot, samples, beat)).encode()


def _wrong_key(w: World) -> Frame:
    return w.seal(WRONG_KEY).close(w.t_ns, w.command(w.kind()).encode())


def _not_sealed(w: World) -> Frame:
    return w.command(w.kind()).encode()


def _sealed_as_another(w: World) -> Frame:
    command = w.command(Kind.TRIP).encode()
    return w.seal(KEY).close(w.t_ns, command._replace(id=Kind.TRIP + STRANGER))._replace(id=Kind.TRIP)


def _another_run(w: World) -> Frame:
    return w.seal(KEY, EPOCH_NS - 3600_000 * MS).close(w.t_ns, w.command(w.kind()).encode())


Fuzzer = Callable[[World], Frame]

ACCIDENTS: dict[str, Fuzzer] = {
    "random": _random,
    "random content": _random_content,
    "1 to 8 bits flipped": _flipped,
    "burst of up to 8 bits": _burst,
    "replayed": _replayed,
    "truncated": _truncated,
    "lengthened": _lengthened,
    "extended, or other FD": _other_format,
    "under the other's identifier": _other_identifier,
    "1 to 20 s old": _stale,
    "0.1 to 20 s ahead": _future,
    "under test": _under_test,
    "for others": _for_others,
}
ATTACKS: dict[str, Fuzzer] = {
    "trip by a wrong key": _wrong_key,
    "plain trip": _not_sealed,
    "sealed as another's": _sealed_as_another,
    "trip of another run": _another_run,
}


@dataclass(slots=True)
class Outcome:
    """What came of a fuzz."""

    frames: Counter[str] = field(default_factory=Counter)
    causes: dict[str, Counter[Rejection]] = field(default_factory=dict)
    passed_over: int = 0  # for others
    accepted: int = 0  # as a repetition, or a state without poles: nothing was operated
    operations: list[tuple[str, Frame, Command]] = field(default_factory=list)
    genuine: Counter[int] = field(default_factory=Counter)  # how often each genuine command was acted upon

    @property
    def refused(self) -> Counter[Rejection]:
        """All causes together."""
        return sum(self.causes.values(), Counter())


def fuzz(
    n: int,
    seed: int,
    *,
    authenticated: bool,
    confirmations: int = 1,
    fuzzers: Mapping[str, Fuzzer] | None = None,
) -> Outcome:
    """`n` frames to a breaker node, and the genuine relay's between them."""
    w = World(Random(seed), authenticated)
    seal = w.seal(KEY)
    relay = RelayNode(RELAY, None, (), 1.0, 0.0, seal=seal)
    breaker = BreakerNode(
        0,
        [RELAY],
        7,
        1.0,
        lambda t_ns, level, text: None,
        seal=w.seal(KEY),
        confirmations=confirmations,
    )
    if fuzzers is None:
        fuzzers = ACCIDENTS | ATTACKS if authenticated else ACCIDENTS
    names = list(fuzzers)
    outcome = Outcome(causes={name: Counter() for name in names})
    step = 0
    for number in range(n + 1):
        w.t_ns = number * SPACING_NS
        if w.t_ns >= step * HALF_PERIOD_NS:
            relay.set(w.t_ns, 7 if step % 4 == 1 else 0, 7 if step % 4 == 3 else 0, 0)
            step += 1
        _genuine(w, relay, breaker, outcome, step)
        if number == n:  # the last instant is the genuine relay's
            break
        name = w.random.choice(names)
        before = breaker.rejected.copy()
        frame = fuzzers[name](w)
        command = breaker.receive(w.t_ns, frame)
        outcome.frames[name] += 1
        refused = breaker.rejected - before
        if refused:
            outcome.causes[name] += refused
        elif command is not None:
            outcome.operations.append((name, frame, command))
        elif breaker.hears(frame.id):
            outcome.accepted += 1
        else:
            outcome.passed_over += 1
    return outcome


def _genuine(w: World, relay: RelayNode, breaker: BreakerNode, outcome: Outcome, step: int) -> None:
    """The frames that the genuine relay has due; what it says on CAN is heard by the fuzzer, too."""
    if relay.next_ns > w.t_ns:
        return
    for frame in relay.poll(w.t_ns):
        command = breaker.receive(w.t_ns, frame)
        if command is not None:
            outcome.genuine[step] += 1
        if breaker.hears(frame.id):
            w.recorded.append(frame)
            del w.recorded[:-2000]
            message = decode(frame._replace(data=frame.data[:8], fd=False))
            assert isinstance(message, State)
            w.newest[message.kind] = message


CONFIGURATIONS = {
    "plain": {"authenticated": False},
    "plain, confirmations = 2": {"authenticated": False, "confirmations": 2},
    "authenticated": {"authenticated": True},
}


def report(quick: bool) -> Report:
    """A million frames to each of three breaker nodes."""
    n = 10_000 if quick else 1_000_000
    result = Report(
        "fuzz",
        f"A breaker node under {n:,} frames it must not act upon",
        text=["10,000 frames/s; between them a relay trips and closes, each to be acted upon once."],
    )
    outcomes = {name: fuzz(n, seed=4, **given) for name, given in CONFIGURATIONS.items()}
    for name, outcome in outcomes.items():
        result.tables.append(_causes_table(name, outcome))
    result.tables.append(residual_table())
    result.checks += residual_checks()
    steps = n * SPACING_NS // HALF_PERIOD_NS
    commands = len([step for step in range(1, steps + 1) if step % 2])
    for name, outcome in outcomes.items():
        result.checks += _checks(name, outcome, commands)
    return result


def _causes_table(name: str, outcome: Outcome) -> Table:
    rows = []
    operated = Counter(kind for kind, _, _ in outcome.operations)
    for kind, causes in outcome.causes.items():
        told = ", ".join(f"{cause.name} {count}" for cause, count in causes.most_common())
        rows.append((kind, outcome.frames[kind], causes.total(), operated[kind], told))
    return Table(
        f"{name}: refused, by kind of frame",
        ("kind", ">frames", ">refused", ">operations", "causes"),
        rows,
        note=f"accepted without an operation {outcome.accepted}, for others {outcome.passed_over}",
    )


def _checks(name: str, outcome: Outcome, commands: int) -> list[Check]:
    accounted = outcome.refused.total() + outcome.passed_over + outcome.accepted + len(outcome.operations)
    wrong = sum(count != 1 for count in outcome.genuine.values()) + abs(len(outcome.genuine) - commands)
    checks = [
        Check(f"{name}: frames not accounted for", abs(outcome.frames.total() - accounted), 0),
        Check(f"{name}: of {commands} genuine commands, not acted upon exactly once", wrong, 0),
    ]
    if name == "plain":
        # CRC-8 is what stands between a frame with several bits wrong and the breaker: see the last table.
        corrupted = outcome.frames["1 to 8 bits flipped"] + outcome.frames["random content"]
        share = len(outcome.operations) / corrupted
        checks.append(Check(f"{name}: operations in each frame with several bits wrong", share, 2e-5))
        others = [kind for kind, _, _ in outcome.operations if kind != "1 to 8 bits flipped"]
        checks.append(Check(f"{name}: operations by anything else", len(others), 0))
    else:
        checks.append(Check(f"{name}: operations", len(outcome.operations), 0))
    if name == "authenticated":
        checks.append(Check(f"{name}: frames accepted", outcome.accepted, 0))
    return checks
