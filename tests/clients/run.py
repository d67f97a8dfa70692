#!/usr/bin/env python3
"""Two foreign tus clients send a large recording through a proxy that cuts: `run.py TROCAR [--mib 500] [--cuts 5]`.

Each client's upload must arrive whole (SHA-256 of what the service gives back) and become a session, each cut may cost at
most 8 MiB sent again, and the service's memory may grow by at most 8 MiB an upload. Exit status 0 if all hold.
"""
import argparse
import asyncio
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import urllib.request
from pathlib import Path

HERE = Path(__file__).resolve().parent
GROWTH_LIMIT_KIB = 8 * 1024
AGAIN_LIMIT = 8 << 20
IN_FLIGHT = 1 << 20


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trocar")
    parser.add_argument("--mib", type=int, default=500)
    parser.add_argument("--cuts", type=int, default=5)
    options = parser.parse_args()
    tools = HERE.parent.parent / "target" / "clients"
    python, node_folder = installed(tools)
    passed = failed = 0
    with tempfile.TemporaryDirectory() as folder:
        service = Service(options.trocar, Path(folder) / "data")
        try:
            token, names = service.prepare()
            for name, command in (("tus-js-client", ["node", str(node_folder / "upload.mjs")]),
                                  ("tus-py-client", [str(python), str(HERE / "upload.py")])):
                clip = recording(options.trocar, Path(folder), name, options.mib)
                ok = one_client(name, command, service, token, names, clip, options.cuts)
                passed, failed = passed + ok, failed + (not ok)
        finally:
            service.stop()
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


def installed(tools):
    """Both clients from their registries, outside the tree."""
    tools.mkdir(parents=True, exist_ok=True)
    python = tools / "venv" / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", tools / "venv"], check=True)
        subprocess.run([python, "-m", "pip", "install", "-q", "tuspy==1.1.0"], check=True)
    for name in ("package.json", "upload.mjs"):
        (tools / name).write_text((HERE / name).read_text())
    if not (tools / "node_modules").exists():
        subprocess.run(["npm", "install", "--silent", "--no-package-lock"], cwd=tools, check=True)
    return python, tools


def recording(trocar, folder, name, mib):
    """A simulated exercise in full HD, coded without loss and repeated until it is as long as asked for."""
    scene = folder / f"scene-{name}"
    subprocess.run([trocar, "simulate", "--quiet", "--scene", "pegs", "--seed", str(len(name)), "--seconds", "4",
                    "--size", "1920x1080", "--boards", "0", "--out", scene], check=True)
    clip = folder / f"{name}.mp4"
    subprocess.run(["ffmpeg", "-v", "error", "-stream_loop", "-1", "-i", scene / "clip.mp4", "-fs", str(mib << 20),
                    "-c:v", "libx264", "-preset", "ultrafast", "-qp", "0", clip], check=True)
    return clip


def one_client(name, command, service, token, names, clip, cuts):
    """Sends the clip through a proxy that cuts `cuts` times; true if it came whole and memory stayed flat."""
    proxy = CuttingProxy(service.port, clip.stat().st_size, cuts)
    before = service.peak_kib(reset=True)
    endpoint = f"http://127.0.0.1:{proxy.port}/api/v1/uploads"
    sent = subprocess.run(command + [endpoint, token, str(clip), *names], capture_output=True, text=True)
    grown = service.peak_kib() - before
    session = sent.stdout.strip()
    if sent.returncode or not session:
        print(f"{name}: failed: {sent.stderr.strip()[-500:]}")
        return False
    same = service.sha256_of(f"/api/v1/sessions/{session}/video", token) == sha256_of_file(clip)
    seen = service.session(session, token)
    kept = seen["status"] in ("queued", "tracking", "done") and seen["video"]["bytes"] == clip.stat().st_size
    again = proxy.taken - clip.stat().st_size
    print(f"{name}: {clip.stat().st_size >> 20} MiB, {proxy.cut} cuts that lost {proxy.lost / (1 << 20):.1f} MiB on the "
          f"way, {again / (1 << 20):.1f} MiB sent again, {'whole' if same else 'DAMAGED'}, session {seen['status']}, "
          f"memory grew {grown / 1024:.1f} MiB")
    honest = proxy.cut == cuts and 0 < proxy.lost <= again
    return same and kept and honest and again <= cuts * AGAIN_LIMIT and grown <= GROWTH_LIMIT_KIB


class Service:
    """The real service on a free port."""

    def __init__(self, trocar, data):
        self.process = subprocess.Popen([trocar, "serve", "--data", str(data), "--listen", "127.0.0.1:0", "--workers", "1"],
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.password = self.port = None
        for line in self.process.stdout:
            self.port = self.port or number(re.search(r"http://[^\s:]+:(\d+)", line))
            found = re.search(r"password\S*\s+(\S+)", line)
            self.password = found.group(1) if found else self.password
            if self.port and self.password:
                break
        threading.Thread(target=self.process.stdout.read, daemon=True).start()

    def prepare(self):
        """An administrator's token, and the codes of a trainee, a task and a box."""
        reply, cookie = self.post("/sign-in", {"login": "administrator", "password": self.password})
        headers = {"Cookie": cookie}
        for path, name in (("/trainees", "Ada"), ("/tasks", "Pegs"), ("/boxes", "Box 1")):
            self.post(path, {"name": name}, headers)
        token, _ = self.post("/tokens", {"name": "clients", "role": "administrator"}, headers)
        return token["token"], ("ada", "pegs", "box-1")

    def post(self, path, body, headers=None):
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}/api/v1{path}", json.dumps(body).encode(),
                                         {"Content-Type": "application/json", **(headers or {})})
        with urllib.request.urlopen(request) as reply:
            cookie = (reply.headers.get("Set-Cookie") or "").split(";")[0]
            return json.loads(reply.read() or b"null"), cookie

    def session(self, session, token):
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}/api/v1/sessions/{session}",
                                         headers={"Authorization": f"Bearer {token}"})
        with urllib.request.urlopen(request) as reply:
            return json.loads(reply.read())

    def sha256_of(self, path, token):
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", headers={"Authorization": f"Bearer {token}"})
        digest = hashlib.sha256()
        with urllib.request.urlopen(request) as reply:
            while block := reply.read(1 << 20):
                digest.update(block)
        return digest.hexdigest()

    def peak_kib(self, reset=False):
        """Highest resident set since the last reset, KiB."""
        if reset:
            Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmHWM:\s+(\d+)", status).group(1))

    def stop(self):
        self.process.terminate()
        self.process.wait(timeout=20)


class CuttingProxy:
    """Carries TCP to the service like a long line: what it has taken from the client arrives later. It cuts `cuts` times,
    evenly over the expected bytes; what is then on the way is lost, as on a real line."""

    def __init__(self, to_port, size, cuts):
        self.to_port, self.taken, self.lost, self.cut = to_port, 0, 0, 0
        self.marks = [size * (i + 1) // (cuts + 1) for i in range(cuts)]
        ready = threading.Event()
        threading.Thread(target=lambda: asyncio.run(self.serve(ready)), daemon=True).start()
        ready.wait()

    async def serve(self, ready):
        server = await asyncio.start_server(self.connection, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        ready.set()
        await asyncio.Event().wait()

    async def connection(self, reader, writer):
        """Both directions, until the line is cut or either side is gone: then neither has it any more."""
        to_reader, to_writer = await asyncio.open_connection("127.0.0.1", self.to_port)
        line = Line()
        try:
            async with asyncio.TaskGroup() as both:
                both.create_task(self.take(reader, line))
                both.create_task(line.deliver(to_writer))
                both.create_task(self.give_back(to_reader, writer))
        except* (ConnectionError, OSError):
            pass
        finally:
            self.lost += line.bytes
            writer.transport.abort()
            to_writer.transport.abort()

    async def take(self, reader, line):
        while block := await reader.read(64 * 1024):
            self.taken += len(block)
            await line.put(block)
            if self.marks and self.taken >= self.marks[0]:
                self.marks.pop(0)
                self.cut += 1
                raise ConnectionAbortedError
        await line.put(b"")

    async def give_back(self, reader, writer):
        while block := await reader.read(64 * 1024):
            writer.write(block)
            await writer.drain()
        writer.close()


class Line:
    """Up to IN_FLIGHT bytes on their way, each block for a hundredth of a second. What is there when it is cut is lost."""

    def __init__(self):
        self.blocks, self.bytes, self.changed = [], 0, asyncio.Condition()

    async def put(self, block):
        async with self.changed:
            await self.changed.wait_for(lambda: self.bytes < IN_FLIGHT)
            self.blocks.append((asyncio.get_running_loop().time() + 0.01, block))
            self.bytes += len(block)
            self.changed.notify_all()

    async def deliver(self, writer):
        while True:
            async with self.changed:
                await self.changed.wait_for(lambda: self.blocks)
                due, block = self.blocks[0]
            await asyncio.sleep(due - asyncio.get_running_loop().time())
            if not block:
                writer.close()
                return
            async with self.changed:
                self.blocks.pop(0)
                self.bytes -= len(block)
                self.changed.notify_all()
            writer.write(block)
            await writer.drain()


def sha256_of_file(path):
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def number(match):
    return int(match.group(1)) if match else None


if __name__ == "__main__":
    main()
