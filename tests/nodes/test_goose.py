"""Repetition and acceptance: every change arrives once, whatever is lost, repeated or replayed."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.io.can.frames import Frame, Rejection, State, decode, ticks
from faultloop.io.can.table import Kind
from faultloop.nodes.goose import MS, Publisher, Repetition, Subscriber

reproducible = settings(derandomize=True, deadline=None)


def message(frame: Frame | None) -> State:
    assert frame is not None
    decoded = decode(frame)
    assert isinstance(decoded, State)
    return decoded


def publications(publisher: Publisher, until_ns: int) -> list[tuple[int, State]]:
    sent = []
    while publisher.next_ns <= until_ns:
        t_ns = publisher.next_ns
        sent.append((t_ns, message(publisher.poll(t_ns))))
    return sent


def test_intervals_double_up_to_the_heartbeat():
    publisher = Publisher(Kind.TRIP, 0)
    publisher.set(7, 10 * MS)
    sent = publications(publisher, 5000 * MS)
    times = [t_ns // MS - 10 for t_ns, _ in sent]
    assert times[:10] == [0, 2, 6, 14, 30, 62, 126, 254, 510, 1022]
    assert times[10:13] == [2022, 3022, 4022]
    assert [m.sq_num for _, m in sent] == list(range(len(sent)))
    assert {m.st_num for _, m in sent} == {2} and {m.poles for _, m in sent} == {7}
    assert [m.counter for _, m in sent] == [n % 15 for n in range(len(sent))]


def test_states_that_no_frame_has_told_are_not_counted():
    """Two poles that open between two frames: one new state, and its receiver takes it at once."""
    publisher, subscriber = Publisher(Kind.BREAKER_STATUS, 0, poles=7), Subscriber()
    first = decode(publisher.poll(0))
    assert subscriber.receive(first, 0) is True
    publisher.set(0b110, 10 * MS)
    publisher.set(0b010, 11 * MS)
    second = decode(publisher.poll(11 * MS))
    assert (second.st_num, second.sq_num, second.poles) == (first.st_num + 1, 0, 0b010)
    assert subscriber.receive(second, 11 * MS) is True
    publisher.set(0b000, 20 * MS)  # and back again before a frame was sent: nothing has happened
    publisher.set(0b010, 21 * MS)
    third = decode(publisher.poll(21 * MS))
    assert (third.st_num, third.sq_num, third.poles) == (second.st_num, 1, 0b010)
    assert subscriber.receive(third, 21 * MS) is False
    assert not subscriber.rejected


def test_nothing_is_due_between():
    publisher = Publisher(Kind.TRIP, 0)
    assert publisher.poll(0) is not None
    assert publisher.poll(1) is None
    publisher.set(0, 1)  # no change
    assert publisher.poll(1) is None


def test_sequence_number_wraps_past_zero():
    publisher = Publisher(Kind.PILOT, 3, repetition=Repetition(heartbeat_ns=4 * MS))
    sent = publications(publisher, 1100 * MS)
    numbers = [m.sq_num for _, m in sent]
    assert numbers[254:258] == [254, 255, 1, 2]
    subscriber = Subscriber()
    assert [subscriber.receive(m, t) for t, m in sent] == [True] + [False] * (len(sent) - 1)
    assert not subscriber.rejected


def test_a_state_is_accepted_once():
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()
    for t_ns, m in publications(publisher, 50 * MS):
        subscriber.receive(m, t_ns)
    publisher.set(7, 60 * MS)
    sent = publications(publisher, 200 * MS)
    answers = [subscriber.receive(m, t_ns) for t_ns, m in sent]
    assert answers == [True] + [False] * (len(sent) - 1)
    assert subscriber.poles == 7
    # The same again, all of it: nothing is accepted a second time, nor seen as a change.
    assert {subscriber.receive(m, 210 * MS) for _, m in sent} == {Rejection.OLD}
    assert subscriber.rejected[Rejection.OLD] == len(sent)


def test_replay_of_an_older_state_is_rejected():
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()
    assert subscriber.receive(message(publisher.poll(0)), 0) is True
    publisher.set(7, 10 * MS)
    trip = message(publisher.poll(10 * MS))
    assert subscriber.receive(trip, 10 * MS) is True
    publisher.set(0, 300 * MS)
    assert subscriber.receive(message(publisher.poll(300 * MS)), 300 * MS) is True
    assert subscriber.receive(trip, 400 * MS) is Rejection.OLD
    assert subscriber.receive(trip, 5000 * MS) is Rejection.STALE
    assert Subscriber().receive(trip, 5000 * MS) is Rejection.STALE  # also for a node that starts only now
    assert subscriber.poles == 0


def test_a_change_within_one_tick_of_the_clock_is_not_lost():
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()
    assert subscriber.receive(message(publisher.poll(1000)), 1000) is True
    publisher.set(7, 1001)
    assert subscriber.receive(message(publisher.poll(1001)), 1001) is True


def test_frames_under_test_are_for_receivers_under_test():
    under_test = Publisher(Kind.TRIP, 1, test=True)
    m = message(under_test.poll(0))
    assert Subscriber().receive(m, 0) is Rejection.TEST
    assert Subscriber(test=True).receive(m, 0) is True


def test_other_poles_under_the_same_state_number():
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()
    subscriber.receive(message(publisher.poll(0)), 0)
    m = message(publisher.poll(2 * MS))
    assert subscriber.receive(m._replace(poles=7), 2 * MS) is Rejection.INCONSISTENT
    assert subscriber.poles == 0


def test_a_silent_publisher_raises_one_alarm():
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()
    sent = publications(publisher, 100 * MS)
    for t_ns, m in sent:
        assert not subscriber.supervise(t_ns)
        subscriber.receive(m, t_ns)
    last_ns, last = sent[-1]
    limit = last_ns + Repetition().allowed_to_live_ns(last.sq_num)
    assert not subscriber.supervise(limit - 1)
    assert subscriber.supervise(limit)
    assert not subscriber.supervise(limit + 1)
    assert subscriber.alarm and subscriber.poles == 0
    t_ns = publisher.next_ns
    assert subscriber.receive(message(publisher.poll(t_ns)), t_ns) is False
    assert not subscriber.alarm


def test_a_restarted_publisher_rejoins():
    old, subscriber = Publisher(Kind.TRIP, 1), Subscriber()
    for n in range(1, 40):
        old.set(n % 2, n * 10 * MS)
        subscriber.receive(message(old.poll(n * 10 * MS)), n * 10 * MS)
    assert subscriber.poles == 1
    restarted = Publisher(Kind.TRIP, 1, start_ns=500 * MS)
    # One frame out of sequence may be an accident; the second tells that it is a restart.
    answers = [subscriber.receive(m, t_ns) for t_ns, m in publications(restarted, 502 * MS)]
    assert answers == [Rejection.SEQUENCE, True]
    assert subscriber.restarts == 1 and subscriber.poles == 0
    restarted.set(7, 600 * MS)
    assert subscriber.receive(message(restarted.poll(600 * MS)), 600 * MS) is True


def test_a_restart_in_another_position_under_the_same_number_is_no_contradiction():
    old, subscriber = Publisher(Kind.BREAKER_STATUS, 1, poles=7), Subscriber()
    for t_ns, m in publications(old, 200_000 * MS):
        subscriber.receive(m, t_ns)
    start_ns = 200_100 * MS
    restarted = Publisher(Kind.BREAKER_STATUS, 1, poles=6, start_ns=start_ns)
    answers = [subscriber.receive(m, t_ns) for t_ns, m in publications(restarted, start_ns + 2 * MS)]
    assert answers == [Rejection.SEQUENCE, True]  # sq_num 0, then 1
    assert subscriber.poles == 6


def test_a_restarted_receiver_refuses_what_was_sent_before_it_began_and_acts_on_the_trip_that_stands():
    publisher = Publisher(Kind.TRIP, 1)
    publisher.poll(0)
    publisher.set(7, 100 * MS)
    before = publications(publisher, 500 * MS)
    recording = [m for _, m in before if m.poles]
    assert len(recording) == 8
    subscriber = Subscriber(start_ns=550 * MS)
    for n, m in enumerate(recording):  # the whole sequence, in its order: numbers and counters are right
        assert subscriber.receive(m, (551 + n) * MS) is Rejection.BEFORE_START
    genuine = publications(publisher, 1700 * MS)  # sent at 610 and 1122 ms
    assert [subscriber.receive(m, t_ns) for t_ns, m in genuine] == [Rejection.SEQUENCE, True]
    assert subscriber.poles == 7
    for m in [*recording, *(m for _, m in genuine)]:
        assert subscriber.receive(m, 1350 * MS) in (Rejection.OLD, Rejection.STALE)


def test_one_frame_out_of_sequence_is_not_acted_upon():
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()
    for t_ns, m in publications(publisher, 100 * MS):
        subscriber.receive(m, t_ns)
    last_ns, last = publications(publisher, 130 * MS)[-1]
    assert subscriber.receive(last, last_ns) is False
    now_ns = 140 * MS
    odd = last._replace(time=ticks(now_ns), poles=7)
    jump = odd._replace(st_num=9, sq_num=0, counter=(odd.counter + 1) % 15)
    same_counter = odd._replace(st_num=2, sq_num=0)
    stuck = odd._replace(poles=0, sq_num=odd.sq_num + 1)
    for m in (jump, same_counter, stuck):
        assert subscriber.copied().receive(m, now_ns) is Rejection.SEQUENCE
    publisher.set(7, now_ns)
    assert subscriber.receive(jump, now_ns) is Rejection.SEQUENCE
    assert subscriber.receive(message(publisher.poll(now_ns + MS)), now_ns + MS) is True  # at once


def test_a_trip_after_a_lost_state_is_acted_upon_with_its_second_frame():
    publisher, subscriber = Publisher(Kind.TRIP, 1, poles=7), Subscriber()
    for t_ns, m in publications(publisher, 2 * MS):
        subscriber.receive(m, t_ns)
    publisher.set(0, 100 * MS)
    publications(publisher, 250 * MS)  # all lost
    publisher.set(7, 300 * MS)
    answers = [subscriber.receive(m, t_ns) for t_ns, m in publications(publisher, 310 * MS)]
    assert answers == [Rejection.SEQUENCE, True, False]


def test_with_two_confirmations_each_change_takes_two_frames():
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber(confirmations=2)
    assert [subscriber.receive(m, t_ns) for t_ns, m in publications(publisher, 2 * MS)] == [False, True]
    publisher.set(7, 100 * MS)
    answers = [subscriber.receive(m, t_ns) for t_ns, m in publications(publisher, 106 * MS)]
    assert answers == [False, True, False] and not subscriber.rejected


def test_a_time_ahead_is_refused():
    publisher = Publisher(Kind.TRIP, 1)
    m = message(publisher.poll(0))._replace(time=ticks(101 * MS))
    assert Subscriber().receive(m, 0) is Rejection.STALE
    assert Subscriber().receive(m, MS) is True


@pytest.mark.parametrize("silence_ms", [1, 5000])
def test_without_a_common_clock_an_earlier_time_needs_a_silence(silence_ms):
    subscriber = Subscriber(max_age_ns=None)
    running = Publisher(Kind.TRIP, 1, start_ns=0)
    for _, m in publications(running, 50_000 * MS):
        subscriber.receive(m, 50_000 * MS)
    restarted = publications(Publisher(Kind.TRIP, 1, poles=7), 2 * MS)  # its clock began again
    answers = [subscriber.receive(m, (50_000 + silence_ms) * MS + t_ns) for t_ns, m in restarted]
    assert answers == ([Rejection.OLD] * 2 if silence_ms == 1 else [Rejection.SEQUENCE, True])


def test_lost_frames_are_counted():
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()
    sent = publications(publisher, 600 * MS)
    for n, (t_ns, m) in enumerate(sent):
        if n not in (2, 3, 6):
            subscriber.receive(m, t_ns)
    assert subscriber.lost == 3


@reproducible
@given(
    st.lists(st.tuples(st.integers(1, 400), st.integers(0, 7)), min_size=1, max_size=12),
    st.randoms(use_true_random=False),
    st.floats(0, 0.7),
)
def test_the_last_state_arrives_under_loss_duplication_and_replay(changes, random, loss):
    """Whatever gets lost, repeated or replayed: states are accepted in order, and the last one is reached."""
    publisher, subscriber = Publisher(Kind.TRIP, 0), Subscriber()
    now, seen, history, accepted = 0, [0], [], []

    def carry(until_ns: int) -> None:
        for t_ns, m in publications(publisher, until_ns):
            if random.random() >= loss:
                if subscriber.receive(m, t_ns) is True:
                    accepted.append(m.poles)
                history.append(m)
            if history and random.random() < 0.5:
                again = subscriber.receive(random.choice(history), t_ns)
                # A replay of what has not been accepted yet stays unaccepted.
                assert again in (Rejection.OLD, Rejection.STALE, Rejection.SEQUENCE)

    for gap_ms, poles in changes:
        now += gap_ms * MS
        carry(now - 1)
        publisher.set(poles, now)
        if poles != seen[-1]:
            seen.append(poles)
    carry(now + 60_000 * MS)
    assert subscriber.poles == seen[-1]
    remaining = iter(seen)
    assert all(poles in remaining for poles in accepted)  # a subsequence: none twice, none out of order


def test_copies_are_independent():
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()
    other_publisher, other_subscriber = publisher.copied(), subscriber.copied()
    m = message(publisher.poll(0))
    subscriber.receive(m, 0)
    subscriber.receive(m, 0)
    assert other_publisher.next_ns == 0 and other_subscriber.poles is None and not other_subscriber.rejected
    assert message(other_publisher.poll(0)) == m
