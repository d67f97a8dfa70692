#!/usr/bin/env python3
"""Two foreign tus clients upload a large recording through a proxy that cuts connections:
`run.py TROCAR [--mib 500] [--cuts 5]`.

Each upload must arrive complete (SHA-256 of the file that the service returns) and become a session. A client may send at
most 8 MiB again for each cut, and the service's memory may grow by at most 8 MiB for each upload. Exit status 0 if all of
this holds.
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
MAX_GROWTH_KIB = 8 * 1024
MAX_RESENT_PER_CUT = 8 << 20
MAX_IN_FLIGHT = 1 << 20


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trocar")
    parser.add_argument("--mib", type=int, default=500)
    parser.add_argument("--cuts", type=int, default=5)
    options = parser.parse_args()
    tools = HERE.parent.parent / "target" / "clients"
    python, node_folder = install_clients(tools)
    passed = failed = 0
    with tempfile.TemporaryDirectory() as folder:
        service = Service(options.trocar, Path(folder) / "data")
        try:
            token, names = service.prepare()
            for name, command in (("tus-js-client", ["node", str(node_folder / "upload.mjs")]),
                                  ("tus-py-client", [str(python), str(HERE / "upload.py")])):
                clip = make_recording(options.trocar, Path(folder), name, options.mib)
                ok = check_client(name, command, service, token, names, clip, options.cuts)
                passed, failed = passed + ok, failed + (not ok)
        finally:
            service.stop()
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


def install_clients(tools):
    """Installs both clients from their registries, outside the source tree."""
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


def make_recording(trocar, folder, name, mib):
    """A simulated exercise in full HD, encoded losslessly and repeated until the file has the requested size."""
    scene = folder / f"scene-{name}"
    subprocess.run([trocar, "simulate", "--quiet", "--scene", "pegs", "--seed", str(len(name)), "--seconds", "4",
                    "--size", "1920x1080", "--boards", "0", "--out", scene], check=True)
    clip = folder / f"{name}.mp4"
    subprocess.run(["ffmpeg", "-v", "error", "-stream_loop", "-1", "-i", scene / "clip.mp4", "-fs", str(mib << 20),
                    "-c:v", "libx264", "-preset", "ultrafast", "-qp", "0", clip], check=True)
    return clip


def check_client(name, command, service, token, names, clip, cuts):
    """Uploads the clip through a proxy that cuts `cuts` times; true if it arrived complete within the limits above."""
    proxy = CuttingProxy(service.port, clip.stat().st_size, cuts)
    before = service.peak_kib(reset=True)
    endpoint = f"http://127.0.0.1:{proxy.port}/api/v1/uploads"
    sent = subprocess.run(command + [endpoint, token, str(clip), *names], capture_output=True, text=True)
    growth = service.peak_kib() - before
    session = sent.stdout.strip()
    if sent.returncode or not session:
        print(f"{name}: failed: {sent.stderr.strip()[-500:]}")
        return False
    is_same = service.sha256_of(f"/api/v1/sessions/{session}/video", token) == sha256_of_file(clip)
    stored = service.session(session, token)
    is_stored = stored["status"] in ("queued", "tracking", "done") and stored["video"]["bytes"] == clip.stat().st_size
    resent = proxy.received - clip.stat().st_size
    print(f"{name}: {clip.stat().st_size >> 20} MiB, {proxy.cut} cuts that lost {proxy.lost / (1 << 20):.1f} MiB on the "
          f"way, {resent / (1 << 20):.1f} MiB sent again, {'complete' if is_same else 'DAMAGED'}, "
          f"session {stored['status']}, memory grew {growth / 1024:.1f} MiB")
    cuts_took_effect = proxy.cut == cuts and 0 < proxy.lost <= resent
    within_limits = resent <= cuts * MAX_RESENT_PER_CUT and growth <= MAX_GROWTH_KIB
    return is_same and is_stored and cuts_took_effect and within_limits


class Service:
    """Runs the real service on a free port."""

    def __init__(self, trocar, data):
        self.process = subprocess.Popen([trocar, "serve", "--data", str(data), "--listen", "127.0.0.1:0", "--workers", "1"],
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        # The file of the password is there before the address is printed.
        self.port = next(filter(None, (number(re.search(r"http://[^\s:]+:(\d+)", line)) for line in self.process.stdout)))
        file = (Path(data) / "administrator.password").read_text()
        self.password = re.search(r"^password: (\S+)$", file, re.M).group(1)
        threading.Thread(target=self.process.stdout.read, daemon=True).start()

    def prepare(self):
        """Creates and returns an administrator's token and the codes of a trainee, a task and a box."""
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
        """The largest resident set size since the last reset, KiB."""
        if reset:
            Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmHWM:\s+(\d+)", status).group(1))

    def stop(self):
        self.process.terminate()
        self.process.wait(timeout=20)


class CuttingProxy:
    """A TCP proxy with a delay: the bytes that it receives from the client arrive at the service later. It cuts the connection
    `cuts` times, evenly over the expected bytes. Bytes in flight at a cut are lost, as in a real network."""

    def __init__(self, to_port, size, cuts):
        self.to_port, self.received, self.lost, self.cut = to_port, 0, 0, 0
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
        """Forwards both directions until the connection is cut or one side closes it; then closes both sides."""
        to_reader, to_writer = await asyncio.open_connection("127.0.0.1", self.to_port)
        queue = DelayQueue()
        try:
            async with asyncio.TaskGroup() as both:
                both.create_task(self.receive(reader, queue))
                both.create_task(queue.deliver(to_writer))
                both.create_task(self.send_back(to_reader, writer))
        except* (ConnectionError, OSError):
            pass
        finally:
            self.lost += queue.bytes
            writer.transport.abort()
            to_writer.transport.abort()

    async def receive(self, reader, queue):
        while block := await reader.read(64 * 1024):
            self.received += len(block)
            await queue.put(block)
            if self.marks and self.received >= self.marks[0]:
                self.marks.pop(0)
                self.cut += 1
                raise ConnectionAbortedError
        await queue.put(b"")

    async def send_back(self, reader, writer):
        while block := await reader.read(64 * 1024):
            writer.write(block)
            await writer.drain()
        writer.close()


class DelayQueue:
    """Up to MAX_IN_FLIGHT bytes in flight; each block is delivered after 10 ms. Blocks in the queue at a cut are lost."""

    def __init__(self):
        self.blocks, self.bytes, self.changed = [], 0, asyncio.Condition()

    async def put(self, block):
        async with self.changed:
            await self.changed.wait_for(lambda: self.bytes < MAX_IN_FLIGHT)
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
