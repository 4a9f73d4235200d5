"""The example of docs/adding-a-sink.md is installed beside us and used by the service, as a third party would."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from importlib import resources
from pathlib import Path

import pytest

DOC = Path(__file__).parents[2] / "docs" / "adding-a-sink.md"
COMMAND = [sys.executable, "-c", "from lostmotion.daemon.cli import main; main()"]


def code(language: str) -> list[str]:
    """The code blocks of the page in one language."""
    return re.findall(rf"```{language}\n(.*?)```", DOC.read_text(), re.DOTALL)


def install(folder: Path, module: str = "") -> None:
    """What pip does with a package of one module: the module, and its metadata with the entry point."""
    (folder / "lostmotion_webhook.py").write_text(module or code("python")[0])
    point = re.search(r"^example_webhook = \"(.*)\"", code("toml")[0], re.MULTILINE)
    assert point
    info = folder / "lostmotion_webhook-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lostmotion-webhook\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text(f"[lostmotion.sinks]\nexample_webhook = {point[1]}\n")


def command(folder: Path, *arguments: str, table: str = "") -> subprocess.CompletedProcess[str]:
    """A command of a robot with the simulated joints and the example's table in its configuration."""
    text = (resources.files("lostmotion.daemon") / "simulated.toml").read_text()
    path = folder / "robot.toml"
    path.write_text(f'{text}\n[store]\npath = "{folder / "history.db"}"\n{table or code("toml")[1]}')
    return subprocess.run(
        [*COMMAND, *arguments, str(path)],
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


class Server:
    """A web server on loopback that is busy at first; posted: the documents that were sent to it then."""

    def __init__(self) -> None:
        posted, busy = list[dict[str, object]](), [503, 503]
        self.posted = posted

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                sent = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                if not busy:
                    posted.append(sent)
                self.send_response(busy.pop() if busy else 204)
                self.end_headers()

            def log_message(self, *_: object) -> None:
                """Nothing is logged."""

        self.server = HTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/alarms"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


@pytest.mark.slow
def test_the_service_posts_an_alarm_to_the_sink_of_another_package(tmp_path: Path) -> None:
    """The worn elbow of the simulated robot raises an alarm, which arrives with its robot, once, although the server
    refuses it twice; that it is away is logged once, and that it is back."""
    install(tmp_path)
    server = Server()
    table = code("toml")[1].replace("http://127.0.0.1:8080/alarms", server.url) + "again_s = 0.1\n"
    try:
        done = command(tmp_path, "run", "--duration", "8", "--config", table=table)
    finally:
        server.server.shutdown()
        server.server.server_close()
    assert done.returncode == 0, done.stderr
    raised = [each for each in server.posted if each["event"] == "raised"]
    assert [(each["robot"], each["joint"], each["cause"]) for each in raised] == [("simulated", "elbow", "play")]
    assert "Traceback" not in done.stderr
    assert done.stderr.count("cannot be posted to") == done.stderr.count("is back") == 1


def test_config_check_knows_the_keys_and_the_address(tmp_path: Path) -> None:
    """Its address is listed as a socket; a misspelt key is refused, a far end that is away is not looked for."""
    install(tmp_path)
    checked = command(tmp_path, "config", "check", "--json")
    assert checked.returncode == 0, checked.stderr
    (socket,) = json.loads(checked.stdout)["sockets"]
    assert (socket["of"], socket["does"]) == ("example_webhook", "connects")
    assert socket["address"] == "http://127.0.0.1:8080/alarms"
    refused = command(tmp_path, "config", "check", table='[alarm.example_webhook]\nuri = "x"\n')
    assert refused.returncode == 2
    assert "alarm.example_webhook.uri: unknown key; did you mean url?" in refused.stderr


@pytest.mark.parametrize(
    ("module", "expected"),
    [
        (
            "import nowhere",
            "'example_webhook' cannot be loaded from lostmotion_webhook:SINK: No module named 'nowhere'",
        ),
        ("SINK = 3", "'example_webhook': lostmotion_webhook:SINK is no lostmotion.daemon.sinks.SinkType"),
    ],
)
def test_a_broken_package_is_refused_in_one_line(tmp_path: Path, module: str, expected: str) -> None:
    """A package that cannot be imported, or names something else."""
    install(tmp_path, module)
    refused = command(tmp_path, "config", "check")
    assert refused.returncode == 2
    assert f"alarm.example_webhook: sink {expected}" in refused.stderr
    assert refused.stderr.count("\n") == 1


def test_a_sink_that_cannot_be_opened_ends_the_start_in_one_line(tmp_path: Path) -> None:
    """What the constructor of another package's sink raises is named with its table."""
    broken = code("python")[0].replace('        self.problem = ""\n', "        raise OSError('no net')\n", 1)
    install(tmp_path, broken)
    refused = command(tmp_path, "run", "--duration", "1", "--config")
    assert refused.returncode == 2
    assert "alarm.example_webhook: the sink cannot be opened: OSError('no net')" in refused.stderr
    assert "Traceback" not in refused.stderr
