"""Another stack of IEC 61850, libiec61850, as a program: what it hears and sees it tells as lines of JSON.

hear INTERFACE GOCBREF APPID COUNT        so many GOOSE messages
say INTERFACE GOCBREF DATSET GOID APPID   a quiescent trip three times, then one of poles A and C twice
see INTERFACE APPID COUNT                 so many samples
sample INTERFACE SVID APPID COUNT         so many samples
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import pyiec61850.pyiec61850 as stack

different: list[Any] = []


def tell(what: Any) -> None:
    """Once: the receiver of Sampled Values gives the first message twice.  Nothing before it is ready: until
    its socket is bound, the other interfaces' messages come, too."""
    if what == "ready" or ("ready" in different and what not in different):
        print(json.dumps(what), flush=True)
        different.append(what)


def end(count: int = 0) -> None:
    """When so many different messages have come, or ten seconds are over; at once, as the binding does not
    survive that its objects are given up."""
    until = time.monotonic() + 10
    while len(different) < count and time.monotonic() < until:
        time.sleep(0.01)
    os._exit(0)


def tell_ready() -> None:
    """Once a packet socket of this process is bound to its interface: a receiver that is running may not have
    one yet, as its thread opens it."""
    until = time.monotonic() + 10
    while not _listens() and time.monotonic() < until:
        time.sleep(0.005)
    time.sleep(0.05)  # what had come by then has been dropped
    tell("ready")


def _listens() -> bool:
    own = set()
    for number in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):  # one that is closed by now
            own.add(str(number.readlink()))
    rows = [line.split() for line in Path("/proc/net/packet").read_text(encoding="ascii").splitlines()[1:]]
    return any(row[4] != "0" and row[5] == "1" and f"socket:[{row[8]}]" in own for row in rows)


def mac(kind: int, place: int) -> tuple[int, ...]:
    return 0x01, 0x0C, 0xCD, kind, place >> 8, place & 0xFF


class Heard(stack.GooseHandler):
    def trigger(self) -> None:
        s = self._libiec61850_goose_subscriber
        values = stack.GooseSubscriber_getDataSetValues(s)
        elements = [stack.MmsValue_getElement(values, i) for i in range(stack.MmsValue_getArraySize(values))]
        tell(
            {
                "st_num": stack.GooseSubscriber_getStNum(s),
                "sq_num": stack.GooseSubscriber_getSqNum(s),
                "error": stack.GooseSubscriber_getParseError(s),
                "live_ms": stack.GooseSubscriber_getTimeAllowedToLive(s),
                "go_id": stack.GooseSubscriber_getGoId(s),
                "data_set": stack.GooseSubscriber_getDataSet(s),
                "conf_rev": stack.GooseSubscriber_getConfRev(s),
                "test": stack.GooseSubscriber_isTest(s),
                "needs_commissioning": stack.GooseSubscriber_needsCommission(s),
                "changed_ms": stack.GooseSubscriber_getTimestamp(s),
                "values": [
                    stack.MmsValue_getBoolean(e)
                    if stack.MmsValue_getType(e) == stack.MMS_BOOLEAN
                    else stack.MmsValue_getBitStringAsInteger(e)
                    for e in elements
                ],
            }
        )


def hear(interface: str, reference: str, app_id: str, count: str) -> None:
    subscriber = stack.GooseSubscriber_create(reference, None)
    stack.GooseSubscriber_setAppId(subscriber, int(app_id))
    handler, bridge = Heard(), stack.GooseSubscriberForPython()
    bridge.setLibiec61850GooseSubscriber(subscriber)
    bridge.setEventHandler(handler)
    bridge.subscribe()
    receiver = stack.GooseReceiver_create()
    stack.GooseReceiver_addSubscriber(receiver, subscriber)
    stack.GooseReceiver_setInterfaceId(receiver, interface)
    stack.GooseReceiver_start(receiver)
    assert stack.GooseReceiver_isRunning(receiver)
    tell_ready()
    end(1 + int(count))


def parameters(kind: int, place: int, app_id: int) -> Any:
    own = stack.CommParameters()
    own.vlanPriority, own.vlanId, own.appId = 4, 0, app_id
    stack.CommParameters_setDstAddress(own, *mac(kind, place))
    return own


def say(interface: str, reference: str, data_set: str, go_id: str, app_id: str) -> None:
    publisher = stack.GoosePublisher_create(parameters(1, int(app_id) & 0xFFF, int(app_id)), interface)
    stack.GoosePublisher_setGoCbRef(publisher, reference)
    stack.GoosePublisher_setDataSetRef(publisher, data_set)
    stack.GoosePublisher_setGoID(publisher, go_id)
    stack.GoosePublisher_setConfRev(publisher, 1)
    stack.GoosePublisher_setTimeAllowedToLive(publisher, 2000)
    tell("ready")
    for poles, count in ((0, 3), (5, 2)):
        if poles:
            stack.GoosePublisher_increaseStNum(publisher)
        for _ in range(count):
            values = stack.LinkedList_create()
            for value in (poles != 0, *(bool(poles >> p & 1) for p in range(3))):
                stack.LinkedList_add(values, stack.MmsValue_newBoolean(value))
            stack.LinkedList_add(values, stack.MmsValue_newBitString(13))
            assert stack.GoosePublisher_publish(publisher, values) == 0
            time.sleep(0.01)
    end()


class Seen(stack.SVHandler):
    def trigger(self) -> None:
        asdu = self._libiec61850_sv_asdu
        size = stack.SVSubscriber_ASDU_getDataSize(asdu)
        tell(
            {
                "sv_id": stack.SVSubscriber_ASDU_getSvId(asdu),
                "count": stack.SVSubscriber_ASDU_getSmpCnt(asdu),
                "conf_rev": stack.SVSubscriber_ASDU_getConfRev(asdu),
                "values": [stack.SVSubscriber_ASDU_getINT32(asdu, at) for at in range(0, size, 4)],
            }
        )


def see(interface: str, app_id: str, count: str) -> None:
    receiver = stack.SVReceiver_create()
    stack.SVReceiver_setInterfaceId(receiver, interface)
    subscriber = stack.SVSubscriber_create(None, int(app_id))
    handler, bridge = Seen(), stack.SVSubscriberForPython()
    bridge.setLibiec61850SVSubscriber(subscriber)
    bridge.setEventHandler(handler)
    bridge.subscribe()
    stack.SVReceiver_addSubscriber(receiver, subscriber)
    stack.SVReceiver_start(receiver)
    assert stack.SVReceiver_isRunning(receiver)
    tell_ready()
    end(1 + int(count))


def sample(interface: str, sv_id: str, app_id: str, count: str) -> None:
    publisher = stack.SVPublisher_create(parameters(4, int(app_id) & 0xFFF, int(app_id)), interface)
    asdu = stack.SVPublisher_addASDU(publisher, sv_id, None, 1)
    places = [
        (stack.SVPublisher_ASDU_addINT32(asdu), stack.SVPublisher_ASDU_addQuality(asdu)) for _ in range(8)
    ]
    stack.SVPublisher_setupComplete(publisher)
    tell("ready")
    for n in range(int(count)):
        for k, (value, quality) in enumerate(places, 1):
            stack.SVPublisher_ASDU_setINT32(asdu, value, (k if k < 5 else k - 1) * n)
            stack.SVPublisher_ASDU_setQuality(asdu, quality, 0)  # it is not cleared by itself
        stack.SVPublisher_ASDU_setSmpCnt(asdu, n)
        stack.SVPublisher_publish(publisher)
    end()


if __name__ == "__main__":
    {"hear": hear, "say": say, "see": see, "sample": sample}[sys.argv[1]](*sys.argv[2:])
