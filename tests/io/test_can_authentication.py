"""Seals against RFC 4493 and a frame by hand; what is forged, replayed or recorded elsewhere is refused."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.ciphers import Cipher, algorithms, modes

from faultloop.errors import InputError
from faultloop.io.can.authentication import PLAIN, SEALED_BYTES, CmacSeal, Seal, unsealed
from faultloop.io.can.frames import Frame, Rejection, State
from faultloop.io.can.keys import load_keys
from faultloop.io.can.table import Kind

MS = 1_000_000
KEY = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
EPOCH = 1_577_836_800_000_000_000
TRIP = State(Kind.TRIP, 0, 7, 2, 0, 1, 100).encode()


def cmac_by_hand(key: bytes, message: bytes) -> bytes:
    """RFC 4493 from AES alone: subkeys by doubling, the last block padded or not, then CBC-MAC."""

    def double(block: bytes) -> bytes:
        number = int.from_bytes(block, "big") << 1
        return ((number & (1 << 128) - 1) ^ (0x87 if number >> 128 else 0)).to_bytes(16, "big")

    def encrypt(block: bytes) -> bytes:
        return Cipher(algorithms.AES(key), modes.ECB()).encryptor().update(block)

    k1 = double(encrypt(bytes(16)))
    whole = bool(message) and len(message) % 16 == 0
    padded = message if whole else message + b"\x80" + bytes(-(len(message) + 1) % 16)
    mask = k1 if whole else double(k1)
    mac = bytes(16)
    for at in range(0, len(padded), 16):
        block = padded[at : at + 16]
        if at + 16 == len(padded):
            block = bytes(a ^ b for a, b in zip(block, mask, strict=True))
        mac = encrypt(bytes(a ^ b for a, b in zip(mac, block, strict=True)))
    return mac


@pytest.mark.parametrize(
    ("length", "tag"),
    [
        (0, "bb1d6929e95937287fa37d129b756746"),
        (16, "070a16b46b4d4144f79bdd9dd04a287c"),
        (40, "dfa66747de9ae63030ca32611497c827"),
        (64, "51f0bebf7e3b9d92fc49741779363cfe"),
    ],
)
def test_the_vectors_of_rfc_4493(length: int, tag: str) -> None:
    message = bytes.fromhex(
        "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e51"
        "30c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17ad2b417be66c3710"
    )
    assert cmac_by_hand(KEY, message[:length]).hex() == tag


def seal(start_ns: int = 0, key: bytes = KEY, epoch_ns: int = EPOCH) -> CmacSeal:
    return CmacSeal({Kind.TRIP: key, Kind.TRIP + 1: key}, epoch_ns, start_ns)


def test_a_frame_by_hand() -> None:
    sealed = seal().close(5 * MS, TRIP)
    freshness = (EPOCH + 5 * MS).to_bytes(8, "little")
    tag = cmac_by_hand(KEY, b"\x10\x00\x00\x00" + TRIP.data + freshness)
    assert sealed == Frame(0x010, TRIP.data + freshness + tag, extended=False, fd=True, brs=True)
    assert len(sealed.data) == SEALED_BYTES[8]
    assert seal().open(6 * MS, sealed) == TRIP
    assert unsealed(sealed) == TRIP and unsealed(TRIP) == TRIP


def test_plain_passes_frames_as_they_are() -> None:
    plain: Seal = PLAIN
    assert plain.open(0, plain.close(0, TRIP)) is TRIP


def test_freshness_rises_within_one_instant() -> None:
    sender, receiver = seal(), seal()
    first, second = sender.close(MS, TRIP), sender.close(MS, TRIP)
    assert receiver.open(MS, first) == TRIP
    assert receiver.open(MS, second) == TRIP
    assert receiver.open(MS, second) is Rejection.OLD
    assert receiver.open(MS, first) is Rejection.OLD


def test_any_bit_that_changes_breaks_the_tag() -> None:
    sealed = seal().close(MS, TRIP)
    for bit in range(8 * SEALED_BYTES[8]):
        data = bytearray(sealed.data)
        data[bit // 8] ^= 1 << bit % 8
        assert seal().open(MS, sealed._replace(data=bytes(data))) is Rejection.TAG


def test_what_is_refused() -> None:
    sealed = seal().close(10 * MS, TRIP)
    refused = {
        Rejection.NOT_AUTHENTICATED: TRIP,
        Rejection.FORMAT: sealed._replace(extended=True),
        Rejection.LENGTH: sealed._replace(data=sealed.data[:24]),
        Rejection.UNKNOWN_ID: sealed._replace(id=0x012),
    }
    for cause, frame in refused.items():
        assert seal().open(10 * MS, frame) is cause
    assert seal().open(10 * MS, sealed._replace(id=0x011)) is Rejection.TAG  # the identifier is in the tag
    assert seal(key=bytes(16)).open(10 * MS, sealed) is Rejection.TAG
    assert seal().open(1010 * MS, sealed) == TRIP
    assert seal().open(1010 * MS + 1, sealed) is Rejection.STALE
    assert seal().open(-90 * MS, sealed) == TRIP
    assert seal().open(-90 * MS - 1, sealed) is Rejection.STALE
    assert seal(start_ns=10 * MS + 1).open(11 * MS, sealed) is Rejection.BEFORE_START


def test_a_frame_of_another_run_is_refused() -> None:
    yesterday = seal(epoch_ns=EPOCH - 86_400_000 * MS).close(10 * MS, TRIP)
    tomorrow = seal(epoch_ns=EPOCH + 86_400_000 * MS).close(10 * MS, TRIP)
    assert seal().open(10 * MS, yesterday) is Rejection.STALE
    assert seal().open(10 * MS, tomorrow) is Rejection.STALE


def key_file(folder: Path, text: str, mode: int = 0o600) -> Path:
    path = folder / "keys.toml"
    path.write_text(text, encoding="utf-8")
    path.chmod(mode)
    return path


def test_keys_of_all_and_of_one(tmp_path: Path) -> None:
    path = key_file(tmp_path, f'default = "{KEY.hex()}"\n[senders]\nQA = "{"0F" * 16}"\n')
    assert load_keys(path, ["RA", "QA"]) == {"RA": KEY, "QA": bytes([15] * 16)}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('default = "00"', "default: must have 32 hexadecimal digits (16 bytes), not 2"),
        (f'default = "{"g" * 32}"', "default: must have hexadecimal digits only, 32 of them"),
        (f'default = "{" 0" * 16}"', "default: must have hexadecimal digits only, 32 of them"),
        ("default = 12", "default: must be a string of 32 hexadecimal digits"),
        ("default = [", "is not valid TOML"),
        ("", "senders: there is no key for 'RA': give it here, or a default"),
        (f'[senders]\nRA = "{"0" * 32}"', "senders: there is no key for 'QA'"),
        (
            f'[senders]\nRAA = "{"0" * 32}"',
            "senders.RAA: no relay or breaker has this name; did you mean 'RA'?",
        ),
        ("senders = 1", "senders: must be a table"),
        (f'defualt = "{"0" * 32}"', "defualt: unknown key; did you mean 'default'?"),
    ],
)
def test_a_wrong_key_file_is_refused(tmp_path: Path, text: str, says: str) -> None:
    path = key_file(tmp_path, text)
    with pytest.raises(InputError) as refusal:
        load_keys(path, ["RA", "QA"])
    assert str(refusal.value).startswith(f"{path}: {says}")
    assert "0" * 32 not in str(refusal.value)


def test_a_key_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load_keys(tmp_path / "none.toml", ["RA"])


@pytest.mark.skipif(os.name != "posix", reason="mode bits are POSIX")
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o601])
def test_a_key_file_for_others_is_refused(tmp_path: Path, mode: int) -> None:
    path = key_file(tmp_path, f'default = "{"0" * 32}"', mode)
    with pytest.raises(InputError, match=rf"others than its owner may use it \(mode {mode:04o}\)"):
        load_keys(path, ["RA"])


@pytest.mark.skipif(os.name != "posix", reason="owners are POSIX")
def test_a_key_file_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = key_file(tmp_path, f'default = "{"0" * 32}"')
    own = path.stat().st_uid
    assert load_keys(path, ["RA"])
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    if own == 0:  # root's file is root's word
        assert load_keys(path, ["RA"])
        os.chown(path, 1234, -1)
        monkeypatch.setattr(os, "geteuid", lambda: 0)
    with pytest.raises(InputError, match="belongs to another user"):
        load_keys(path, ["RA"])
