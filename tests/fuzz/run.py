#!/usr/bin/env python3
"""Schemathesis makes requests from the service's OpenAPI document, as every role and signed out:
`run.py TROCAR [--seconds 120]`, for each of the five callers.

No answer may have the status 5xx. A caller who may not see group two must receive no byte of its trainee's name, and must
leave everything of group two as it was. Exit status 0 if all of this holds.
"""
import argparse
import json
import re
import subprocess
import sys
import tempfile
import threading
import urllib.error
import urllib.request
from pathlib import Path

HERE = Path(__file__).resolve().parent
PASSWORD = "a password of tests"
MARKER = "Planted-Trainee-Of-Group-Two"
MISSING = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44"
# They never end, or end the caller's own sign-in.
LEFT_OUT = ("/events", "/feed", "/feed.ts", "/live", "/sign-out", "/sign-in", "/me/password", "/me/sign-ins/{id}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trocar")
    parser.add_argument("--seconds", type=int, default=120)
    options = parser.parse_args()
    schemathesis = install(HERE.parent.parent / "target" / "fuzz")
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        centre = Centre(options.trocar, Path(folder) / "data")
        try:
            description = Path(folder) / "openapi.json"
            for name, headers in centre.callers():
                description.write_text(json.dumps(centre.description()))
                if not fuzz(schemathesis, centre, description, name, headers, options.seconds):
                    failed.append(name)
        finally:
            centre.stop()
    print(f"failed: {', '.join(failed)}" if failed else "all callers passed")
    sys.exit(1 if failed else 0)


def install(tools):
    """Installs the tool from its registry, outside the source tree."""
    program = tools / "venv" / "bin" / "schemathesis"
    if not program.exists():
        tools.mkdir(parents=True, exist_ok=True)
        subprocess.run([sys.executable, "-m", "venv", tools / "venv"], check=True)
        subprocess.run([tools / "venv" / "bin" / "pip", "install", "-q", "schemathesis==4.32.5"], check=True)
    return program


def fuzz(schemathesis, centre, description, name, headers, seconds):
    """True if all answers to this caller are as they must be."""
    before = centre.state_of_group_two()
    report = description.with_name(f"{name}.har")
    command = [schemathesis, "run", description, "--url", centre.base, "--checks", "not_a_server_error",
               "--phases", "coverage,fuzzing", "--max-examples", "30", "--max-time", str(seconds), "--no-shrink", "--continue-on-failure", "--workers", "2",
               "--request-timeout", "30", "--warnings", "off", "--report-har-path", report]
    for header in headers.items():
        command += ["--header", ": ".join(header)]
    subprocess.run(command, stdout=subprocess.DEVNULL, cwd=description.parent)  # judged by its report
    answers = json.loads(report.read_text())["log"]["entries"] if report.exists() else []
    faults = [entry for entry in answers if entry["response"]["status"] >= 500 and not is_busy(entry)]
    is_shown = name != "administrator" and MARKER in report.read_text()
    changes = [] if name == "administrator" else list(differences("", before, centre.state_of_group_two()))
    print(f"{name}: {len(answers)} answers, {len(faults)} faults{', DATA OF GROUP TWO SHOWN' if is_shown else ''}"
          f"{', DATA OF GROUP TWO CHANGED' if changes else ''}", flush=True)
    for change in changes[:10]:
        print(f"  {change}")
    for entry in faults[:10]:
        print(f"  {entry['response']['status']} {entry['request']['method']} {entry['request']['url']}")
    return len(answers) > 100 and not (faults or is_shown or changes)


def differences(path, before, after):
    """A line for each value that differs: the path to it, the value before and after."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in sorted({*before, *after}):
            yield from differences(f"{path}/{key}", before.get(key), after.get(key))
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for index, pair in enumerate(zip(before, after)):
            yield from differences(f"{path}/{index}", *pair)
    elif before != after:
        yield f"{path}: {json.dumps(before)[:300]} became {json.dumps(after)[:300]}"


def is_busy(entry):
    """True if a limit is reached for the moment: a refusal, not a fault."""
    return entry["response"]["status"] == 503


class Centre:
    """Runs the real service on a free port, with two groups that have one of everything."""

    def __init__(self, trocar, data):
        self.process = subprocess.Popen([trocar, "serve", "--data", str(data), "--listen", "127.0.0.1:0", "--workers", "1"],
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.base, password = None, None
        for line in self.process.stdout:
            found = re.search(r"http://[^\s/]+", line)
            self.base = self.base or (found and found.group())
            found = re.search(r"password\S*\s+(\S+)", line)
            password = password or (found and found.group(1))
            if self.base and password:
                break
        threading.Thread(target=self.process.stdout.read, daemon=True).start()
        self.administrator = self.sign_in("administrator", password)
        self.ids = {}
        for number, trainee in (("one", "Ada"), ("two", MARKER)):
            self.fill(number, trainee)

    def fill(self, number, trainee):
        """A group, its people, and one of everything that it can have."""
        group = self.make("groups", {"name": f"Group {number}"})
        trainee = self.make("trainees", {"name": trainee, "code": f"trainee-{number}", "group": group})
        person = {"name": number, "password": PASSWORD}
        self.make("people", {**person, "login": f"trainee-{number}", "role": "trainee", "trainee": trainee})
        instructor = self.make("people", {**person, "login": f"instructor-{number}", "role": "instructor", "groups": [group]})
        owned = {"groups": [group]}
        box = self.make("boxes", {"name": f"Box {number}", "code": f"box-{number}", **owned})
        task = self.make("tasks", {"name": f"Task {number}", "code": f"task-{number}", **owned})
        steps = [{"task": task, "sessions": 1}]
        course = self.make("courses", {"name": f"Plan {number}", "steps": steps, **owned})
        cohort = self.make("cohorts", {"name": f"Cohort {number}"})
        query = f"trainee={trainee}&task={task}&box={box}"
        clip, rows = b"\0\0\0\x20ftypisom" + number.encode() * 20, ["frame,time_s,tool,x_mm,y_mm,z_mm"]
        # Each group has other rows: a session names those with the same recording, so it would change with them.
        depth_mm = {"one": 150, "two": 160}[number]
        rows += [f"{frame},{frame / 25},left,{frame % 40},{frame % 7},{depth_mm}" for frame in range(250)]
        sent = self.send("POST", f"sessions?{query}&filename=clip.mp4", clip, {"Content-Type": "video/mp4"})
        imported = self.send("POST", f"sessions/import?{query}", "\n".join(rows).encode(), {"Content-Type": "text/csv"})
        for noun, ids in {"groups": [group], "trainees": [trainee], "people": [instructor], "boxes": [box], "tasks": [task],
                          "courses": [course], "cohorts": [cohort], "sessions": [sent["id"], imported["id"]]}.items():
            self.ids.setdefault(noun, []).extend(ids)

    def callers(self):
        """Name and headers of each caller, those with the fewest rights first."""
        agent = self.send("POST", "tokens", json.dumps({"name": "agent", "role": "agent", "box": "box-one"}).encode(),
                          {"Content-Type": "application/json"})["token"]
        return [("stranger", {}), ("agent", {"Authorization": f"Bearer {agent}"}),
                ("trainee", self.sign_in("trainee-one", PASSWORD)),
                ("instructor", self.sign_in("instructor-one", PASSWORD)), ("administrator", self.administrator)]

    def description(self):
        """The OpenAPI document, with the ids of this centre: without them nearly every answer is 404. What is deleted is
        missing or in use, so that the centre stays as it is for the next request."""
        document = self.send("GET", "openapi.json")
        for path in [path for path in document["paths"] if path.endswith(LEFT_OUT)]:
            del document["paths"][path]
        for path, item in document["paths"].items():
            noun = path.removeprefix("/api/v1/").split("/")[0]
            for method, operation in item.items():
                known = [] if method == "delete" else self.ids.get(noun, [])
                for parameter in operation.get("parameters", []):
                    if parameter["in"] == "path" and parameter["name"] == "id":
                        parameter["schema"] = {"type": "string", "enum": [*known, MISSING, "no-such-code"]}
        return document

    def state_of_group_two(self):
        """Everything of group two that another group must not change."""
        second = {noun: self.ids[noun][len(self.ids[noun]) // 2:] for noun in ("groups", "trainees", "people", "boxes", "tasks",
                                                                              "courses", "sessions")}
        instructors = second.pop("people")
        people = [person for person in self.send("GET", "people?limit=200")["items"] if person["id"] in instructors]
        state = {noun: [self.send("GET", f"{noun}/{of}") for of in ids] for noun, ids in second.items()}
        for session in state["sessions"]:
            session.pop("queue_position")  # it depends on the sessions of others
        parts = {part: [self.send("GET", f"sessions/{of}/{part}") for of in second["sessions"]]
                 for part in ("comments", "edits", "ratings")}
        return {**state, "people": people, **parts}

    def sign_in(self, login, password):
        body = json.dumps({"login": login, "password": password}).encode()
        request = urllib.request.Request(f"{self.base}/api/v1/sign-in", body, {"Content-Type": "application/json"})
        with urllib.request.urlopen(request) as reply:
            return {"Cookie": reply.headers["Set-Cookie"].split(";")[0]}

    def make(self, noun, body):
        return self.send("POST", noun, json.dumps(body).encode(), {"Content-Type": "application/json"})["id"]

    def send(self, method, path, body=None, headers=None):
        headers = {**self.administrator, **(headers or {})}
        request = urllib.request.Request(f"{self.base}/api/v1/{path}", body, headers, method=method)
        try:
            with urllib.request.urlopen(request) as reply:
                return json.loads(reply.read() or b"null")
        except urllib.error.HTTPError as error:
            sys.exit(f"{method} {path}: {error.code} {error.read().decode()}")

    def stop(self):
        self.process.terminate()
        self.process.wait()


if __name__ == "__main__":
    main()
