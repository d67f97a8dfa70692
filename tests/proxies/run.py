#!/usr/bin/env python3
"""nginx and Caddy in front of the real service, with the examples of `docs/proxy/`: `run.py TROCAR [--mib 200]`.

Each proxy runs as an ordinary user on loopback ports of its own. Through it, people sign in, a large recording reaches
the service while it is sent, events arrive at once, a feed's frames are acknowledged, failed sign-ins count for the
client's address, and the audit trail names it. It runs a second time with the service under a path, as
`docs/operations.md` describes it. A proxy that is not installed is reported as skipped, and with TROCAR_MUST_NOT_SKIP=1
fails.
"""
import argparse
import base64
import hashlib
import http.client
import json
import os
import re
import shutil
import socket
import ssl
import struct
import subprocess
import sys
import tempfile
import threading
import time
import uuid
import zlib
from pathlib import Path

DOCS = Path(__file__).resolve().parent.parent.parent / "docs"
EXAMPLES = DOCS / "proxy"
# The path that the service lies under in the second run.
BELOW = "/trocar"
PATIENCE_S = 60
# Events that a proxy holds back arrive when the stream ends, or not at all.
AT_ONCE_S = 3
UNPRIVILEGED = 65534


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trocar")
    parser.add_argument("--mib", type=int, default=200)
    options = parser.parse_args()
    passed = failed = 0
    for name, proxy in (("nginx", Nginx), ("caddy", Caddy)):
        if not find(name):
            print(f"SKIPPED {name}: it is not installed; `make proxies` installs it", file=sys.stderr, flush=True)
            failed += os.environ.get("TROCAR_MUST_NOT_SKIP") == "1"
            continue
        for path, checks in (("", CHECKS), (BELOW, CHECKS_BELOW)):
            with tempfile.TemporaryDirectory() as folder:
                folder = Path(folder)
                folder.chmod(0o755)
                service = Service(options.trocar, folder, path)
                try:
                    with proxy(folder, service) as front:
                        for check in checks:
                            ok = run_check(name + path, check, front, service, options)
                            passed, failed = passed + ok, failed + (not ok)
                finally:
                    service.stop()
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


def run_check(name, check, front, service, options):
    claim = check.__name__.replace("_", " ")
    try:
        began = time.monotonic()
        check(front, service, options)
        print(f"{name}: {claim}: ok, {time.monotonic() - began:.1f} s", flush=True)
        return True
    except Exception as error:  # each check is one result; the next one runs all the same
        print(f"{name}: {claim}: failed: {type(error).__name__}: {error}\n{front.log()}", flush=True)
        return False


# ── what must hold behind each proxy ─────────────────────────────────────────────────────────────────────────────────

def a_person_signs_in_from_the_page(front, service, _):
    status, headers, _ = front.request("POST", "/api/v1/sign-in", service.credentials, origin=True)
    assert status == 200, f"status {status}"
    cookie = headers["Set-Cookie"].split(";")[0]
    assert "max-age=" in headers.get("Strict-Transport-Security", ""), "no HSTS: the service does not know of HTTPS"
    status, _, _ = front.request("GET", "/api/v1/me", headers={"Cookie": cookie})
    assert status == 200, f"me: status {status}"
    status, _, _ = front.request("POST", "/api/v1/sign-in", service.credentials, headers={"Origin": "https://evil.example"})
    assert status == 403, f"a page of another site: status {status}"


def a_sign_in_shows_the_address_of_the_client(front, service, _):
    status, headers, _ = front.request("POST", "/api/v1/sign-in", service.credentials, source="127.0.0.2")
    assert status == 200, f"status {status}"
    cookie = headers["Set-Cookie"].split(";")[0]
    status, _, shown = front.request("GET", "/api/v1/me/sign-ins", headers={"Cookie": cookie}, source="127.0.0.2")
    assert status == 200, f"sign-ins: status {status}"
    addresses = [entry["address"] for entry in json.loads(shown)["items"] if entry["is_current"]]
    assert addresses == ["127.0.0.2"], addresses


def the_audit_trail_names_the_address_of_the_client(front, service, _):
    stated = {"X-Forwarded-For": "192.0.2.1", "Forwarded": "for=192.0.2.1"}
    for address, name in (("127.0.0.2", "Cutting"), ("127.0.0.3", "Knots")):
        status, _, made = front.request("POST", "/api/v1/tasks", {"name": name}, {**service.authorization, **stated}, source=address)
        assert status == 201, f"status {status}"
        status, _, shown = front.request("GET", "/api/v1/audit-entries", headers=service.authorization)
        assert status == 200, f"audit-entries: status {status}"
        task = json.loads(made)["id"]
        addresses = [entry["address"] for entry in json.loads(shown)["items"] if entry["subject"] == task]
        assert addresses == [address], addresses


def an_upload_continues_at_its_location(front, service, _):
    recording, tus = os.urandom(1 << 16), {"Tus-Resumable": "1.0.0", **service.authorization}
    metadata = {"filename": "piece.mp4", "trainee": service.trainee, "task": service.task, "box": service.box}
    metadata = ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in metadata.items())
    status, headers, _ = front.request("POST", "/api/v1/uploads", headers={
        "Upload-Length": str(len(recording)), "Upload-Metadata": metadata, **tus})
    assert status == 201, f"status {status}"
    location = headers["Location"]
    assert location.startswith(f"{front.path}/api/v1/uploads/"), location
    half = {"Upload-Offset": "0", "Content-Type": "application/offset+octet-stream", **tus}
    status, headers, _ = front.request_at("PATCH", location, recording[:len(recording) // 2], half)
    assert (status, headers["Upload-Offset"]) == (204, str(len(recording) // 2)), f"status {status}"
    status, headers, _ = front.request_at("HEAD", location, headers=tus)
    assert (status, headers["Upload-Offset"]) == (200, str(len(recording) // 2)), f"status {status}"


def browsers_get_http2_and_plain_http_a_redirect(front, _service, _):
    shown = subprocess.run(["curl", "-sk", "--http2", "-o", "/dev/null", "-w", "%{http_version} %{http_code}", f"{front.base}{front.path}/"],
                           capture_output=True, text=True, check=True).stdout
    assert shown == "2 200", shown
    if front.plain_port:
        plain = http.client.HTTPConnection("127.0.0.1", front.plain_port, timeout=PATIENCE_S)
        plain.request("GET", "/sessions?a=b", headers={"Host": "localhost"})
        answer = plain.getresponse()
        location = answer.getheader("Location")
        assert (answer.status, location) == (308, "https://localhost/sessions?a=b"), f"{answer.status} {location}"


def a_large_recording_passes_while_it_is_sent(front, service, options):
    size = options.mib << 20
    clip = service.clip.read_bytes()
    pieces = [clip, *[os.urandom(1 << 20)] * (options.mib - 1)]
    pieces.append(bytes(size - sum(map(len, pieces))))
    connection = front.connect()
    connection.putrequest("POST", f"{front.path}/api/v1/sessions?{service.subject}&filename=large.mp4")
    for header, value in (("Authorization", f"Bearer {service.token}"), ("Content-Type", "video/mp4"), ("Content-Length", str(size))):
        connection.putheader(header, value)
    connection.endheaders()
    half, before = len(pieces) // 2, service.stored_bytes()
    for piece in pieces[:half]:
        connection.send(piece)
    sent = sum(map(len, pieces[:half]))
    poll("half of the recording is with the service before the rest is sent",
         lambda: service.stored_bytes() - before > sent - (16 << 20))
    for piece in pieces[half:]:
        connection.send(piece)
    answer = connection.getresponse()
    body = answer.read()
    assert answer.status in (200, 201, 202), f"status {answer.status}: {body[:300]}"
    session = json.loads(body)["id"]
    status, _, video = front.request("GET", f"/api/v1/sessions/{session}/video", headers=service.authorization)
    digests = [hashlib.sha256(data).hexdigest() for data in (b"".join(pieces), video)]
    assert status == 200 and digests[0] == digests[1], f"status {status}, {len(video)} bytes returned"


def events_arrive_at_once(front, service, _):
    connection = front.connect()
    connection.request("GET", f"{front.path}/api/v1/events", headers=service.authorization)
    stream = connection.getresponse()
    assert stream.status == 200, f"status {stream.status}"
    connection.sock.settimeout(AT_ONCE_S)
    assert stream.readline().strip() == b"event: queue", "the stream begins with the length of the queue"
    sent = front.request("POST", f"/api/v1/sessions?{service.subject}&filename=short.mp4", service.clip.read_bytes(),
                         headers={"Content-Type": "video/mp4", **service.authorization})
    assert sent[0] in (200, 201, 202), f"status {sent[0]}"
    deadline = time.monotonic() + AT_ONCE_S
    while stream.readline().strip() != b"event: session":
        assert time.monotonic() < deadline, "no event of the new session"
    connection.close()


def frames_of_a_feed_are_acknowledged(front, service, _):
    with front.open_socket() as wire:
        feed = WebSocket(wire, f"localhost:{front.port}", f"{front.path}/api/v1/boxes/{service.box}/feed", service.token)
        feed.send_text({"type": "hello", "protocol": 1, "recording": str(uuid.uuid4()), "trainee": service.trainee,
                        "task": service.task, "codec": "jpeg", "width": 320, "height": 240, "time_base": [1, 90000],
                        "began_at": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), "sender": "proxies"})
        welcome = feed.read_json()
        assert welcome["type"] == "welcome", welcome
        feed.send_frame(welcome["epoch"], 0, service.picture)
        acknowledged = feed.read_json()
        assert (acknowledged["type"], acknowledged["durable"]) == ("ack", [[0, 0]]), acknowledged


def failed_sign_ins_count_for_the_address_of_the_client(front, service, _):
    """The service allows twelve failures a minute from one address, over all logins."""
    def fails_from(address, number, forged=None):
        headers = {"X-Forwarded-For": forged, "Forwarded": f"for={forged}"} if forged else {}
        body = {"login": f"stranger-{number}", "password": "not the right one"}
        return front.request("POST", "/api/v1/sign-in", body, headers=headers, source=address)[0]
    answers = [fails_from("127.0.0.2", number, f"192.0.2.{number}") for number in range(1, 16)]
    assert answers[0] == 401 and answers[-1] == 429, f"a client that states other addresses: {answers}"
    assert fails_from("127.0.0.3", 99) == 401, "another client does not have to wait"


CHECKS_BELOW = [a_person_signs_in_from_the_page, a_sign_in_shows_the_address_of_the_client,
                the_audit_trail_names_the_address_of_the_client, an_upload_continues_at_its_location, events_arrive_at_once,
                frames_of_a_feed_are_acknowledged]
CHECKS = [*CHECKS_BELOW, browsers_get_http2_and_plain_http_a_redirect, a_large_recording_passes_while_it_is_sent,
          failed_sign_ins_count_for_the_address_of_the_client]


# ── the service and the proxies ──────────────────────────────────────────────────────────────────────────────────────

class Service:
    """The real service on a free port, under a path, with a trainee, a task, a box and a token."""

    def __init__(self, trocar, folder, path):
        self.path = path
        self.data, self.log = folder / "data", open(folder / "service.log", "w+")
        scene = folder / "scene"
        subprocess.run([trocar, "simulate", "--quiet", "--scene", "pegs", "--seed", "1", "--seconds", "1", "--size", "320x240",
                        "--boards", "0", "--out", scene], check=True)
        self.clip = scene / "clip.mp4"
        self.picture = subprocess.run(["ffmpeg", "-v", "error", "-i", self.clip, "-frames:v", "1", "-f", "mjpeg", "-"],
                                      capture_output=True, check=True).stdout
        settings = folder / "trocar.toml"
        settings.write_text('listen = "127.0.0.1:0"\nworkers = 1\n[http]\ntrusted_proxies = ["127.0.0.1"]\nfree_attempts = 1\n'
                            + f'base_path = "{path}"\n')
        self.process = subprocess.Popen([trocar, "serve", "--data", self.data, "--settings", settings],
                                        stdout=subprocess.PIPE, stderr=self.log, text=True)
        self.port = password = None
        for line in self.process.stdout:
            found = re.search(r"http://[^\s:]+:(\d+)", line)
            self.port = self.port or found and int(found.group(1))
            found = re.search(r"password\S*\s+(\S+)", line)
            password = found.group(1) if found else password
            if self.port and password:
                break
        assert self.port and password, "the service does not start: " + (folder / "service.log").read_text()
        threading.Thread(target=self.process.stdout.read, daemon=True).start()
        self.credentials = {"login": "administrator", "password": password}
        self.prepare()

    def prepare(self):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)

        def post(path, body, headers):
            connection.request("POST", f"{self.path}/api/v1{path}", json.dumps(body), {"Content-Type": "application/json", **headers})
            answer = connection.getresponse()
            text = answer.read()
            assert answer.status in (200, 201), f"{path}: {answer.status} {text}"
            return json.loads(text), answer.headers

        _, headers = post("/sign-in", self.credentials, {})
        cookie = {"Cookie": headers["Set-Cookie"].split(";")[0]}
        for path, name in (("/trainees", "Ada"), ("/tasks", "Pegs"), ("/boxes", "Box 1")):
            post(path, {"name": name}, cookie)
        self.trainee, self.task, self.box = "ada", "pegs", "box-1"
        self.subject = f"trainee={self.trainee}&task={self.task}&box={self.box}"
        self.token = post("/tokens", {"name": "proxies", "role": "administrator"}, cookie)[0]["token"]
        self.authorization = {"Authorization": f"Bearer {self.token}"}

    def stored_bytes(self):
        sizes = 0
        for path in self.data.rglob("*"):
            try:
                sizes += path.stat().st_size if path.is_file() else 0
            except FileNotFoundError:
                pass  # moved or deleted meanwhile
        return sizes

    def stop(self):
        self.process.terminate()
        self.process.wait(timeout=20)
        self.log.close()


class Proxy:
    """A proxy that runs as an ordinary user, with its example adapted to ports and a certificate of the test."""

    program = None

    def __init__(self, folder, service):
        self.path = service.path
        self.folder = folder / self.program
        self.folder.mkdir()
        self.port, self.plain_port = free_port(), None
        self.base = f"https://localhost:{self.port}"
        self.certificate, self.key = self.folder / "certificate.pem", self.folder / "key.pem"
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
                        "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost", "-keyout", self.key,
                        "-out", self.certificate], check=True, capture_output=True)
        self.tls = ssl.create_default_context(cafile=self.certificate)
        command = self.configure(service.port)
        as_user = {"user": UNPRIVILEGED, "group": UNPRIVILEGED, "extra_groups": []} if os.geteuid() == 0 else {}
        for path in [self.folder, *self.folder.rglob("*")] if as_user else []:
            os.chown(path, UNPRIVILEGED, UNPRIVILEGED)
        self.output = open(self.folder / "output", "w")
        self.process = subprocess.Popen(command, stdout=self.output, stderr=self.output, env={"HOME": str(self.folder)}, **as_user)

    def __enter__(self):
        try:
            poll(f"{self.program} answers", self.answers)
            return self
        except BaseException:
            print(self.log(), flush=True)
            self.__exit__()
            raise

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(timeout=20)
        self.output.close()

    def answers(self):
        try:
            return self.request("GET", "/readyz")[0] == 200
        except OSError:
            return False

    def log(self):
        return (self.folder / "output").read_text()[-1500:]

    def open_socket(self, source=None):
        plain = socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S, source_address=source and (source, 0))
        return self.tls.wrap_socket(plain, server_hostname="localhost")

    def connect(self, source=None):
        connection = http.client.HTTPConnection("localhost", self.port, timeout=PATIENCE_S)
        connection.sock = self.open_socket(source)
        return connection

    def request(self, method, path, body=None, headers=None, origin=False, source=None):
        """A request at an address of the service, without its path."""
        return self.request_at(method, self.path + path, body, headers, origin, source)

    def request_at(self, method, path, body=None, headers=None, origin=False, source=None):
        connection = self.connect(source)
        headers = {**({"Origin": self.base} if origin else {}), **(headers or {})}
        if isinstance(body, dict):
            body, headers["Content-Type"] = json.dumps(body), "application/json"
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        return answer.status, answer.headers, content


class Nginx(Proxy):
    program = "nginx"

    def configure(self, service_port):
        self.plain_port = free_port()
        site = adapted((EXAMPLES / "nginx.conf").read_text(), {
            "listen 80;": f"listen 127.0.0.1:{self.plain_port};",
            "listen 443 ssl": f"listen 127.0.0.1:{self.port} ssl",
            "/etc/letsencrypt/live/skills.example/fullchain.pem": str(self.certificate),
            "/etc/letsencrypt/live/skills.example/privkey.pem": str(self.key),
            "127.0.0.1:8080": f"127.0.0.1:{service_port}",
            "location / {": f"location {self.path}/ {{",
        })
        (self.folder / "site.conf").write_text(site)
        temporary = "".join(f"{kind}_temp_path {self.folder}/{kind};\n"
                            for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
        main = self.folder / "nginx.conf"
        main.write_text(f"daemon off;\npid {self.folder}/pid;\nerror_log stderr;\nevents {{}}\n"
                        f"http {{\naccess_log off;\n{temporary}include {self.folder}/site.conf;\n}}\n")
        return [find("nginx"), "-p", self.folder, "-c", main, "-e", "stderr"]


class Caddy(Proxy):
    program = "caddy"

    def configure(self, service_port):
        example = documented_caddyfile() if self.path else (EXAMPLES / "Caddyfile").read_text()
        site = adapted(example, {
            "skills.example {": f"localhost:{self.port} {{\n\tbind 127.0.0.1\n\ttls {self.certificate} {self.key}",
            "127.0.0.1:8080": f"127.0.0.1:{service_port}",
        })
        path = self.folder / "Caddyfile"
        path.write_text("{\n\tadmin off\n\tauto_https disable_redirects\n}\n" + site)
        return [find("caddy"), "run", "--config", path, "--adapter", "caddyfile"]


def documented_caddyfile():
    """The example of `docs/operations.md` for a path of a host."""
    return re.search(r"With Caddy:\n\n```\n(.*?)```", (DOCS / "operations.md").read_text(), re.DOTALL).group(1)


def adapted(text, changes):
    """The example with ports and paths of the test. A change that finds nothing to change is an error."""
    for old, new in changes.items():
        assert old in text, f"the example does not contain `{old}`"
        text = text.replace(old, new)
    return text


class WebSocket:
    """The parts of RFC 6455 that a feed needs, as a client."""

    def __init__(self, wire, host, path, token):
        self.wire = wire
        key = base64.b64encode(os.urandom(16)).decode()
        wire.sendall((f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                      f"Sec-WebSocket-Key: {key}\r\nAuthorization: Bearer {token}\r\n\r\n").encode())
        self.read = wire.makefile("rb")
        status = self.read.readline()
        assert b" 101 " in status, status
        while self.read.readline().strip():
            pass

    def send_text(self, message):
        self.send(1, json.dumps(message).encode())

    def send_frame(self, epoch, number, picture):
        head = struct.pack(">BBHIQqI", 1, 1, 0, epoch, number, 0, len(picture))
        self.send(2, head + struct.pack(">I", zlib.crc32(head + picture)) + picture)

    def send(self, opcode, payload):
        mask = os.urandom(4)
        length = len(payload)
        size = struct.pack(">BBH", 0x80 | opcode, 0xFE, length) if length >= 126 else struct.pack(">BB", 0x80 | opcode, 0x80 | length)
        if length > 0xFFFF:
            size = struct.pack(">BBQ", 0x80 | opcode, 0xFF, length)
        masked = bytes(byte ^ mask[at % 4] for at, byte in enumerate(payload))
        self.wire.sendall(size + mask + masked)

    def read_json(self):
        """The next text message. Pings are left unanswered: the test is shorter than the server's patience."""
        while True:
            first, length = self.read.read(2)
            if length == 126:
                length, = struct.unpack(">H", self.read.read(2))
            payload = self.read.read(length)
            assert first & 15 != 8, f"closed: {payload}"
            if first & 15 == 1:
                return json.loads(payload)


def find(program):
    return shutil.which(program) or shutil.which(program, path="/usr/sbin:/usr/local/sbin")


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def poll(what, holds):
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline, f"this did not happen in {PATIENCE_S} s: {what}"
        time.sleep(0.05)


if __name__ == "__main__":
    main()
