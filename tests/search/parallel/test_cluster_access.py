"""Who can use a cluster: nobody but the run that started it, and who has its certificates."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from vinefab.core.errors import BadInputError
from vinefab.search import dask_cluster
from vinefab.search.dask_cluster import DaskEvaluator

PROGRAM = """
import gc, http.client, json, os, stat, sys
from pathlib import Path

import dask, psutil
from distributed import Client, get_worker
from distributed.security import Security

from vinefab.search.dask_cluster import DaskEvaluator

def ports():
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    return [
        (process.pid != os.getpid(), connection.laddr.port)
        for process in processes
        for connection in process.net_connections()
        if connection.status == psutil.CONN_LISTEN
    ]

def status(port, path):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=2)
    try:
        connection.request("GET", path)
        return connection.getresponse().status
    except (OSError, http.client.HTTPException):
        return None
    finally:
        connection.close()

def answers():
    paths = ["/health", "/info", "/status", "/metrics", "/sitemap.json"]
    return [(worker, port, path, status(port, path)) for worker, port in ports() for path in paths]

def admitted(address, security=None):
    try:
        with Client(address, security=security, timeout=1.5) as client:
            return client.submit(os.getpid).result(timeout=5)
    except (OSError, TypeError):  # TypeError: no certificates at all
        return None
    finally:
        # dask hangs where what is left of a refused client is deleted while another starts.
        gc.collect()

def folder_modes():
    folder = Path(get_worker().local_directory)
    return [oct(stat.S_IMODE(path.stat().st_mode)) for path in list(folder.parents)[:2]]

def main():
    seen = {}
    with DaskEvaluator("local:1")._client() as client:
        client.wait_for_workers(1)
        address = client.scheduler.address
        bare = address.split("://")[1]
        seen["address"] = address
        seen["folder_modes"] = client.submit(folder_modes).result()
        seen["answers"] = answers()
        for thing, name in (("plain", f"tcp://{bare}"), ("tls", address)):
            seen[f"{thing} without"] = admitted(name)
        worker = next(iter(client.scheduler_info()["workers"])).split("://")[1]
        seen["plain at the worker"] = admitted(f"tcp://{worker}")
        seen["tls with others"] = admitted(address, Security.temporary())

        folder, own = Path(sys.argv[1]), client.security
        files = {"ca-file": own.tls_ca_file, "client.cert": own.tls_client_cert,
                 "client.key": own.tls_client_key}
        for name, content in files.items():
            (folder / name).write_text(content)
        named = {f"distributed.comm.tls.{name}": str(folder / name) for name in files}
        with dask.config.set(named), DaskEvaluator(address)._client() as other:
            seen["tls with its files"] = other.submit(len, "abc").result(timeout=5)

        client.restart(timeout=60)
        seen["answers of another worker"] = answers()
    (Path(sys.argv[1]) / "seen.json").write_text(json.dumps(seen))

if __name__ == "__main__":
    main()
"""


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What a program sees that tries to get into a local cluster."""
    folder = tmp_path_factory.mktemp("access")
    program = folder / "program.py"
    program.write_text(PROGRAM)
    command = [sys.executable, program, folder]
    subprocess.run(command, check=True, timeout=120)
    return json.loads((folder / "seen.json").read_text())


def test_a_local_cluster_admits_only_its_own_run(seen):
    assert seen["address"].startswith("tls://127.0.0.1:")
    for stranger in ("plain without", "plain at the worker", "tls without", "tls with others"):
        assert seen[stranger] is None, stranger


@pytest.mark.parametrize("moment", ["answers", "answers of another worker"])
def test_nothing_answers_over_http(seen, moment):
    assert {worker for worker, *_ in seen[moment]} == {True, False}
    assert [answer for answer in seen[moment] if answer[-1] is not None] == []


def test_nobody_else_can_change_what_workers_import(seen):
    assert seen["folder_modes"][-1] == "0o700"


def test_a_scheduler_with_tls_takes_its_files_from_dask_s_settings(seen):
    assert seen["tls with its files"] == 3


@pytest.fixture
def tls_files(tmp_path):
    """Return a function that names files for TLS in dask's settings."""
    import dask  # noqa: PLC0415 - an extra
    import distributed  # noqa: F401, PLC0415 - it loads its settings

    def named(**contents):
        settings = dict.fromkeys(("ca_file", "client.cert", "client.key"))
        for name, content in contents.items():
            path = tmp_path / name
            if content is not None:
                path.write_text(content)
            settings[name.replace("client_", "client.")] = str(path)
        tls = {
            f"distributed.comm.tls.{name.replace('_', '-')}": settings[name] for name in settings
        }
        return dask.config.set(tls)

    return named


PEM = "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"


@pytest.mark.parametrize(
    ("contents", "problem"),
    [
        ({}, "CA_FILE is not set"),
        ({"ca_file": PEM}, "CLIENT__CERT is not set"),
        ({"ca_file": None}, "No such file or directory: .*ca_file"),
        ({"ca_file": PEM, "client_cert": PEM, "client_key": None}, "No such file.*client_key"),
        (
            {"ca_file": "x", "client_cert": "x", "client_key": "x"},
            r"(\[SSL|\[X509|SSL:|certificate)[^)]*\)",
        ),
        ({"ca_file": PEM, "client_cert": PEM}, r"(\[SSL|\[X509|SSL:|certificate)[^)]*\)"),
    ],
)
@pytest.mark.parametrize("kind", ["address", "file"])
def test_missing_and_wrong_tls_files_are_one_line(tls_files, tmp_path, contents, problem, kind):
    address = "tls://127.0.0.1:9"
    if kind == "file":
        (tmp_path / "scheduler.json").write_text(json.dumps({"address": address}))
        address = str(tmp_path / "scheduler.json")
    with (
        tls_files(**contents),
        pytest.raises(BadInputError, match=f"--cluster is .*tls://HOST:PORT.*{problem}") as told,
        DaskEvaluator(address)._client(),
    ):
        pass
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("needed", dask_cluster.NEEDED)
def test_all_that_the_extra_installs_is_needed(monkeypatch, needed):
    def without(name):
        return None if name == needed else found(name)

    found = dask_cluster.importlib.util.find_spec
    monkeypatch.setattr(dask_cluster.importlib.util, "find_spec", without)
    with pytest.raises(BadInputError, match=r"pip install 'vinefab\[cluster\]'"):
        DaskEvaluator("local:2")


def test_tls_files_are_named_in_the_documents():
    text = (Path(__file__).parents[3] / "docs" / "long_runs.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in text for name in dask_cluster.TLS_FILES)
