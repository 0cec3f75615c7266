"""Pages of other hosts get nothing, whatever name they come by."""

import socket

import pytest

from ringlight.view.same_host import is_loopback, refusal


@pytest.mark.parametrize(
    "host", ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "[::1]:8080", "127.0.0.2", "localhost:9000"]
)
def test_this_machine_is_answered(host: str):
    assert refusal([host], [], "127.0.0.1") is None
    assert refusal([host], [f"http://{host}"], "127.0.0.1") is None
    assert refusal([host], [f"https://{host}:443" if ":" not in host else f"https://{host}"], "127.0.0.1") in (
        None,
        "this viewer answers its own pages only",
    )


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8080",
        "192.168.1.5:8080",
        "0.0.0.0:8080",
        "",
        "localhost.evil.example",
        "a:b",
        "[::1",
        "localhost:99999",
    ],
)
def test_another_name_is_refused_where_only_this_machine_may_look(host: str):
    assert refusal([host], [], "127.0.0.1") is not None


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "http://127.0.0.1:3000",
        "http://localhost:8080",
        "null",
        "",
        "file://",
        "ftp://127.0.0.1:8080",
        "http://127.0.0.1:8080.evil.example",
        "127.0.0.1:8080",
    ],
)
def test_another_origin_is_refused(origin: str):
    assert refusal(["127.0.0.1:8080"], [origin], "127.0.0.1") is not None


def test_addresses_are_answered_where_others_may_look_and_names_are_not():
    assert refusal(["192.168.1.5:8080"], ["http://192.168.1.5:8080"], "0.0.0.0") is None
    assert refusal(["[fe80::1]:8080"], [], "0.0.0.0") is None
    assert refusal([f"{socket.gethostname()}:8080"], [], "0.0.0.0") is None
    assert refusal(["viewer.lab:8080"], [], "viewer.lab") is None
    assert refusal(["evil.example:8080"], [], "0.0.0.0") is not None
    assert refusal(["192.168.1.5:8080"], ["http://evil.example"], "0.0.0.0") is not None


def test_headers_that_are_missing_or_come_twice_are_refused():
    assert refusal([], [], "127.0.0.1") is not None
    assert refusal(["127.0.0.1:8080", "evil.example"], [], "127.0.0.1") is not None
    assert refusal(["127.0.0.1:8080"], ["http://127.0.0.1:8080", "http://evil.example"], "127.0.0.1") is not None


def test_the_usual_port_may_be_left_out():
    assert refusal(["localhost"], ["http://localhost:80"], "127.0.0.1") is None
    assert refusal(["localhost:443"], ["https://localhost"], "127.0.0.1") is None


def test_loopback():
    assert is_loopback("127.0.0.1")
    assert is_loopback("localhost")
    assert is_loopback("::1")
    assert not is_loopback("0.0.0.0")
    assert not is_loopback("example.org")
