#!/usr/bin/env python3
"""Measures the figures of docs/accuracy.md on every scene with known truth.

Most parts work as a user would: calibrate → track → evaluate, with photos and annotations as the only inputs, beside the OpenCV
peer and the theoretical limits. Three parts use the true camera and the judge of SHARED/worlds: `worlds` (scenes of an
independent renderer), `degraded` (copies that other programs have spoilt) and `causes` (scenes rendered again with one effect
off; the first run takes an hour and 2 GB of disk, and needs g++).

Usage: python3 benches/figures TROCAR SHARED WORK [--document docs/accuracy.md] [--only PART,…] [--kept] [--quick]

TROCAR is the release binary, SHARED the folder with `scenes/`, `peer/` and `worlds/`, WORK a folder for results. PART is a name
in `PARTS` below. The results of each part are stored in WORK. With `--kept`, a part is measured only if WORK has no results of
this binary and script; so timings can be measured alone, on a quiet machine. `--document` replaces the figures between the two
marks in this file, and the pictures that they show in `images/` beside it. `--quick` runs each part once on short clips to
check that it works; its figures are not for the document.
"""
import argparse
import hashlib
import json
import os
import shutil
import sys
from dataclasses import asdict
from pathlib import Path

import accuracy
import bad_case
import causes
import cost
import degraded
import features
import memory
import rates
import repeatability
import rest
import rivals
import skill
import worlds
from programs import ROUNDS, Bench, Goal, Part
from scenes import Scenes

PARTS = {"accuracy": accuracy, "worlds": worlds, "degraded": degraded, "rivals": rivals, "causes": causes,
         "repeatability": repeatability, "rest": rest, "bad": bad_case, "features": features, "rates": rates, "skill": skill,
         "cost": cost, "memory": memory}
BEGIN, END = "<!-- figures: made by `make figures`; do not edit by hand -->", "<!-- /figures -->"


def main():
    options = arguments()
    bench = Bench(options.trocar.resolve(), options.shared, options.work, options.quick)
    scenes = Scenes(bench)
    goals, tables, pictures = [], [], []
    for name in options.only:
        part = kept(bench, name) if options.kept else None
        if part is None:
            print(f"… {name}", file=sys.stderr)
            part = PARTS[name].measure(bench, scenes)
            keep(bench, name, part)
        goals += part.goals
        tables += part.tables
        pictures += part.pictures
    text = "\n\n".join([goals_table(goals), *tables, note(bench, options.only)])
    print(text)
    if options.document:
        before, rest_of_it = options.document.read_text().split(BEGIN)
        after = rest_of_it.split(END)[1]
        options.document.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}")
        for picture in map(Path, pictures):
            shutil.copyfile(picture, options.document.parent / "images" / picture.name)


def arguments():
    parser = argparse.ArgumentParser(prog="figures", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trocar", type=Path)
    parser.add_argument("shared", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("--document", type=Path)
    parser.add_argument("--only", type=lambda names: names.split(","), default=list(PARTS))
    parser.add_argument("--kept", action="store_true")
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    if unknown := set(options.only) - set(PARTS):
        parser.error(f"unknown part: {', '.join(sorted(unknown))}; the parts are {', '.join(PARTS)}")
    if options.document and options.quick:
        parser.error("--document and --quick exclude each other: figures of short clips are not for the document")
    return options


def keep(bench, name, part):
    place(bench, name).write_text(json.dumps({"of": made_by(bench, name), **asdict(part)}))


def kept(bench, name):
    """The stored results of this part, if they are of this binary and script."""
    if not place(bench, name).exists():
        return None
    known = json.loads(place(bench, name).read_text())
    if known["of"] != made_by(bench, name):
        return None
    return Part([Goal(**goal) for goal in known["goals"]], known["tables"], known.get("pictures", []))


def place(bench, name):
    return bench.work / f"{name}{'-quick' if bench.quick else ''}.json"


def made_by(bench, name):
    """Hash of the binary and of the part's script."""
    sources = [bench.trocar, Path(PARTS[name].__file__)]
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


def goals_table(goals):
    rows = [f"| {goal.name} | {goal.goal} | {goal.reached} | {goal.verdict()} |" for goal in goals]
    return "\n".join(["| figure | goal | reached | |", "|---|---|---|---|", *rows])


def note(bench, only):
    missing = ", ".join(f"`{name}`" for name in PARTS if name not in only)
    return (f"All figures use only photos and annotations, unless a row says otherwise. {os.cpu_count()} cores; times are medians "
            f"of {bench.rounds(ROUNDS)} interleaved rounds." + (f" Not measured for this table: {missing}." if missing else "") +
            (" QUICK: not for quoting." if bench.quick else ""))


if __name__ == "__main__":
    main()
