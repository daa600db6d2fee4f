"""The page's server: who may connect, what is answered, and what a program in any language can do."""

import asyncio
import json
import os
import signal
import socket
import struct
import time
import urllib.request
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from browsing import Served, calm_rig_file, served
from command_line import run as typed

from zeromethod.operating.run_table import METHODS, RUN

PARTS = ["camera", "surface", "residual", "place", "sigma"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("page")
    rig = calm_rig_file(folder)
    words = (
        "--scenario",
        "hold",
        "--seconds",
        "900",
        "--view",
        "127.0.0.1:0",
        "--control",
        "tcp://127.0.0.1:0",
    )
    with served("run", "--rig", rig, *words, cwd=folder) as one:
        state = f"{one.base}/api/state?token={one.token}"
        while json.loads(urllib.request.urlopen(state).read()).get("state") != "locked":
            time.sleep(0.1)
        yield one


@asynccontextmanager
async def viewer(run: Served, token: str = "") -> AsyncIterator[aiohttp.ClientWebSocketResponse]:
    async with aiohttp.ClientSession() as client:
        url = f"{run.base}/live?token={token or run.token}"
        async with client.ws_connect(url, max_msg_size=0) as socket:
            hello = await socket.receive_json()
            assert hello["hello"] == json.loads(json.dumps(RUN.described()))
            yield socket


def unpacked(data: bytes) -> tuple[dict[str, Any], dict[str, bytes]]:
    (length,) = struct.unpack("<I", data[:4])
    header = json.loads(data[4 : 4 + length])
    rest = data[4 + length :]
    return header, {
        name: rest[part["start"] : part["start"] + part["length"]] for name, part in header["parts"].items()
    }


async def newest(
    socket: aiohttp.ClientWebSocketResponse, *parts: str
) -> tuple[dict[str, Any], dict[str, bytes]]:
    await socket.send_json({"next": parts})
    while True:
        message = await socket.receive(30)
        if message.type is aiohttp.WSMsgType.BINARY:
            return unpacked(message.data)


async def locked(socket: aiohttp.ClientWebSocketResponse) -> dict[str, Any]:
    while True:
        header, _ = await newest(socket, *PARTS)
        if header["values"].get("state") == "locked":
            return header


def status(run: Served, path: str, **headers: str) -> int:
    """Status of a GET by a socket, with these headers and no others."""
    with socket.create_connection(("127.0.0.1", run.port), 10) as plain:
        lines = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in headers.items())
        plain.sendall(f"GET {path} HTTP/1.1\r\n{lines}Connection: close\r\n\r\n".encode())
        return int(plain.recv(64).split()[1])


def test_a_wrong_token_a_foreign_origin_and_a_wrong_host_are_refused_every_time(run):
    host, good = f"127.0.0.1:{run.port}", run.token
    asked = ("/", "/api", "/api/state", "/live")
    websocket = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13"}
    websocket["Sec_WebSocket_Key"] = "dGhlIHNhbXBsZSBub25jZQ=="
    refused = 0
    for number in range(100):
        path = asked[number % 4]
        wrong = ("", "x", good[:-1], good + "x", good.swapcase())[number % 5]
        assert status(run, f"{path}?token={wrong}", Host=host, **websocket) == 403
        origin = ("http://evil.example", "null", f"http://127.0.0.1:{run.port + 1}", f"ftp://{host}")[
            number % 4
        ]
        assert status(run, f"{path}?token={good}", Host=host, Origin=origin, **websocket) == 403
        other = ("evil.example", f"evil.example:{run.port}", f"127.0.0.1.evil.example:{run.port}", "10.0.0.1")
        assert status(run, f"{path}?token={good}", Host=other[number % 4], **websocket) == 421
        refused += 3
    assert refused == 300
    # the page itself, and one seen through a tunnel that ends at another port
    for name in (host, f"localhost:{run.port}", "localhost:1234"):
        assert status(run, f"/api?token={good}", Host=name, Origin=f"http://{name}") == 200


def test_the_page_and_its_files_are_small_and_compressed(run):
    async def sizes() -> dict[str, int]:
        found = {}
        async with aiohttp.ClientSession(auto_decompress=False) as client:
            paths = ["/", *(f"/static/{name}" for name in ("main.js", "style.css", "depth.js"))]
            paths += [
                f"/vendor/{name}"
                for name in ("three.core.min.js", "three.module.min.js", "uPlot.iife.min.js")
            ]
            for path in paths:
                async with client.get(f"{run.base}{path}?token={run.token}") as answer:
                    assert answer.status == 200
                    assert answer.headers["Content-Encoding"] == "gzip"
                    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
                    found[path] = len(await answer.read())
            async with client.get(f"{run.base}/static/../server.py") as answer:
                assert answer.status == 404
        return found

    assert sum(asyncio.run(sizes()).values()) < 1_000_000


def test_a_viewer_gets_one_message_for_each_that_it_asks_for_with_the_parts_it_wants(run):
    async def look() -> None:
        async with viewer(run) as socket:
            header = await locked(socket)
            assert set(header["values"]) == {one.name for one in RUN.values}
            with pytest.raises(asyncio.TimeoutError):
                await socket.receive(0.5)  # nothing that was not asked for
            await socket.send_json({"next": ["camera"], "probe": [8, 8]})
            header, parts = unpacked((await socket.receive(10)).data)
            assert set(parts) == {"camera"}
            assert parts["camera"].startswith(b"\xff\xd8")
            assert header["probe"]["node"] == [8, 8]
            header, parts = await newest(socket, *PARTS)
            rows, columns = header["parts"]["surface"]["shape"]
            assert {name: len(data) for name, data in parts.items() if name != "camera"} == {
                "surface": 2 * rows * columns,
                "residual": 2 * rows * columns,
                "sigma": 2 * rows * columns,
                "place": 4 * rows * columns,
            }
            assert sum(header["parts"]["surface"]["kinds"][::2]) == rows * columns

    asyncio.run(look())


def test_many_viewers_each_get_every_step_of_the_history_once(run):
    async def rows(count: int) -> list[float]:
        async with viewer(run) as socket:
            found: list[float] = []
            for _ in range(count):
                header, _ = await newest(socket)
                found += [row[0] for row in header["rows"]]
            return found

    async def all_rows() -> list[list[float]]:
        return await asyncio.gather(*(rows(12) for _ in range(4)))

    for times in asyncio.run(all_rows()):
        assert times == sorted(set(times))
        assert len(times) >= 8


def test_calls_over_http_act_and_are_refused_in_one_line(run):
    async def talk() -> None:
        async with aiohttp.ClientSession() as client:

            async def post(method: str, body: Any, token: str = "") -> tuple[int, dict[str, Any]]:
                headers = {"Authorization": f"Bearer {token or run.token}"}
                data = body if isinstance(body, str) else json.dumps(body)
                async with client.post(f"{run.base}/api/{method}", data=data, headers=headers) as answer:
                    return answer.status, await answer.json()

            assert await post("gain", {"value": 0.9}) == (200, {"result": {}})
            assert await post("gain", {"value": 7}) == (400, {"error": "gain: value: 7: allowed: 0.01 to 1"})
            assert (await post("dance", {}))[1]["error"].startswith("'dance': no such method; allowed: pause")
            assert await post("gain", "{") == (400, {"error": "not JSON: one object is wanted"})
            assert await post("pause", {}, run.view_token) == (403, {"error": "this token may only view"})
            assert await post("pause", {}, "nonsense") == (403, {"error": "no valid token"})
            values: dict[str, Any] = {"gain": None}
            while values["gain"] != 0.9:  # as of the newest step
                async with client.get(f"{run.base}/api/state?token={run.view_token}") as answer:
                    values = await answer.json()
            assert not values["paused"]
            async with client.get(f"{run.base}/api?token={run.view_token}") as answer:
                assert [one["name"] for one in (await answer.json())["methods"]] == [
                    one.name for one in METHODS
                ]

    asyncio.run(talk())


def lines(port: int, *sent: str, wanted: int) -> list[dict[str, Any]]:
    """What the control socket answers to these lines, events left out."""
    with socket.create_connection(("127.0.0.1", port), 30) as plain:
        plain.sendall("".join(f"{line}\n" for line in sent).encode("latin-1"))
        found: list[dict[str, Any]] = []
        with plain.makefile() as stream:
            for line in stream:
                one = json.loads(line)
                if "event" not in one:
                    found.append(one)
                if len(found) == wanted:
                    break
        return found


def test_the_control_socket_takes_a_token_and_then_an_object_a_line(run):
    port = run.control_port
    asked = (
        '{"id": 1, "call": "pause"}',
        '{"id": 2, "get": "state"}',
        '{"id": 3, "call": "resume", "arguments": {}}',
        '{"id": 4, "get": "api"}',
        '{"id": 5, "call": "gain", "arguments": {"value": "x"}}',
        "nonsense",
        '{"id": 6}',
    )
    answers = lines(port, run.token, *asked, wanted=7)
    assert answers[0] == {"id": 1, "result": {}}
    assert set(answers[1]["result"]) == {one.name for one in RUN.values}
    assert answers[2] == {"id": 3, "result": {}}
    assert answers[3]["result"]["mode"] == "run"
    assert answers[4] == {"id": 5, "error": "gain: value: 'x': a number is wanted"}
    assert answers[5] == {"id": None, "error": "not JSON: one object is wanted"}
    assert answers[6] == {"id": 6, "error": '"call" or "get" ("state", "api") is wanted'}
    wrong = {"error": "no valid token: the first line is the token"}
    assert lines(port, "nonsense", asked[0], wanted=2) == [wrong]
    only = lines(port, run.view_token, asked[0], wanted=1)
    assert only == [{"id": 1, "error": "this token may only view"}]


NOT_TEXT = ('{"note": "\\ud800"}', "not UTF-8: surrogates not allowed")
NOT_SENT = [
    NOT_TEXT,
    ('{"note": NaN}', "not JSON: one object is wanted"),
    ("[" * 10_000, "not JSON: objects or lists too deep inside each other"),
    ("[]", "an object is wanted"),
    ("\xff", "not UTF-8: invalid start byte"),
]


@pytest.mark.parametrize(("body", "words"), NOT_SENT)
def test_a_body_that_is_no_object_of_text_is_refused_everywhere_and_all_goes_on(run, body, words):
    async def post() -> tuple[int, Any]:
        async with (
            aiohttp.ClientSession(headers={"Authorization": f"Bearer {run.token}"}) as client,
            client.post(f"{run.base}/api/mark", data=body.encode("latin-1")) as answer,
        ):
            return answer.status, await answer.json()

    async def closed() -> str:
        async with viewer(run) as socket:
            await socket.send_str(body)
            return str((await socket.receive(30)).extra)

    assert asyncio.run(post()) == (400, {"error": words})
    if body != "\xff":
        assert asyncio.run(closed()) == words
    answers = lines(run.control_port, run.token, body, '{"id": 2, "call": "mark"}', wanted=2)
    assert answers == [{"id": None, "error": words}, {"id": 2, "result": {}}]


def test_a_name_with_half_a_character_and_a_line_without_end_are_answered(run):
    call = '{"id": 1, "call": "mark", "arguments": {"note": "a"}}'
    (refused,) = lines(run.control_port, run.token, call.replace("mark", "\\ud800"), wanted=1)
    assert refused == {"id": None, "error": NOT_TEXT[1]}
    (last,) = lines(run.control_port, run.token, "x" * 70_000, wanted=2)
    assert last == {"error": "a line of more than 65536 bytes: the connection ends"}


HANDSHAKE = (
    b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: \xff"
)


@pytest.mark.parametrize(
    "header",
    [b"Host: [", b"Authorization: Bearer \xff", b"Origin: http://[", b"Content-Encoding: gzip", HANDSHAKE],
)
def test_headers_that_are_none_are_refused(run, header):
    host = b"" if header.startswith(b"Host") else f"Host: {run.base.removeprefix('http://')}\r\n".encode()
    with socket.create_connection(("127.0.0.1", int(run.base.rpartition(":")[2])), 30) as plain:
        what = f"{'GET /live' if header is HANDSHAKE else 'POST /api/mark'}?token={run.token} HTTP/1.1\r\n"
        length = b"" if header is HANDSHAKE else b"\r\nContent-Length: 3"
        plain.sendall(what.encode() + host + header + length + b"\r\n\r\nxyz")
        assert int(plain.recv(12)[9:]) in {400, 403, 421}
    assert not [line for line in run.lines if "Traceback" in line]


def test_what_happens_is_pushed_over_the_control_socket(run):
    with socket.create_connection(("127.0.0.1", run.control_port), 30) as plain:
        plain.sendall(f'{run.token}\n{{"id": 1, "call": "mark", "arguments": {{"note": "now"}}}}\n'.encode())
        with plain.makefile() as stream:
            events = (one["event"] for one in map(json.loads, stream) if "event" in one)
            words = next(event["words"] for event in events if event["kind"] == "call")
    assert words == 'mark {"note": "now"} (socket)'


def test_a_viewer_that_stops_reading_is_dropped_after_ten_seconds_with_a_reason(run):
    async def stall() -> float:
        async with viewer(run) as socket:
            await newest(socket, *PARTS)
            connection = socket._conn  # type: ignore[attr-defined]
            connection.protocol.pause_reading()
            started = time.monotonic()
            while time.monotonic() - started < 20:
                if any("stopped reading" in line for line in run.lines):
                    break
                await asyncio.sleep(0.1)
            connection.transport.abort()  # else closing waits for an answer
            return time.monotonic() - started

    assert 9 < asyncio.run(stall()) < 14
    (line,) = [line for line in run.lines if "stopped reading" in line]
    assert line == "note: view: the viewer at 127.0.0.1 stopped reading for 10 s and was dropped\n"


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("--view nonsense", "--view: 'nonsense': not an address: HOST:PORT, such as 127.0.0.1:8470"),
        ("--view 127.0.0.1:99999", "--view: '127.0.0.1:99999': not an address: "),
        ("--view 203.0.113.7:0", "--view: 203.0.113.7:0: cannot be served: Cannot assign requested address"),
        (
            "--control 127.0.0.1:1",
            "--control: '127.0.0.1:1': not an address: tcp://127.0.0.1:5557 or unix:PATH",
        ),
        ("--control unix:/no/such/folder/x", "--control: unix:/no/such/folder/x: the folder /no/such/folder"),
    ],
)
def test_a_bad_address_is_one_line_and_exit_code_2(option, words):
    code, _, err = typed(f"run --frames 1 {option}")
    assert (code, err.count("\n")) == (2, 1), err
    assert words in err


def test_a_port_in_use_is_one_line_and_exit_code_2():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        code, _, err = typed(f"run --frames 1 --view 127.0.0.1:{port}")
    assert (code, err) == (2, f"zeromethod: --view: 127.0.0.1:{port}: cannot be served: the port is in use\n")


def test_a_unix_socket_is_its_owners_alone_and_needs_no_token(tmp_path):
    rig, path = calm_rig_file(tmp_path), tmp_path / "control"
    words = ("--scenario", "hold", "--seconds", "900", "--control", f"unix:{path}")
    with served("run", "--rig", rig, *words, cwd=tmp_path, wanted=1) as one:
        assert one.urls["control"] == f"unix:{path}"
        assert path.stat().st_mode & 0o777 == 0o600
        with socket.socket(socket.AF_UNIX) as plain:
            plain.settimeout(30)
            plain.connect(str(path))
            with plain.makefile("rw") as stream:
                for _ in range(200):  # it answers from the first moment on, and says so while it starts
                    stream.write('{"id": 1, "call": "stop"}\n')
                    stream.flush()
                    answer = next(each for each in map(json.loads, stream) if "event" not in each)
                    if "result" in answer:
                        break
                    assert answer["error"] in {"stop: it is still starting", "the run is over"}
                    time.sleep(0.1)
        assert one.process.wait(60) in {0, 1}  # too short to have nulled anything
    assert not path.exists()


def test_the_run_goes_on_without_its_server(tmp_path: Path):
    rig = calm_rig_file(tmp_path)
    words = ("--scenario", "hold", "--seconds", "1", "--view", "127.0.0.1:0")
    with served("run", "--rig", rig, *words, cwd=tmp_path, wanted=2) as one:
        children = Path(f"/proc/{one.process.pid}/task/{one.process.pid}/children").read_text().split()
        server = next(pid for pid in children if b"page.server" in Path(f"/proc/{pid}/cmdline").read_bytes())
        os.kill(int(server), signal.SIGKILL)
        assert one.process.wait(120) == 0
    assert "note: the page's server has ended: the run goes on without it\n" in one.lines
