"""Renders one scene of SHARED/worlds again: with all effects, with each effect of sensor or video off, and with other rectangles.

Usage: cause_clips.py RENDERER INDEX FOLDER FRAMES SETS

A folder of scenes comes out, in the layout that SHARED/worlds/judge.py reads. Light is traced once a scene and deleted when all
clips are encoded. A run that was interrupted continues with the clips that are missing.
"""
import copy
import json
import os
import shutil
import sys
from pathlib import Path

RENDERER, INDEX, FOLDER, FRAMES, SETS = Path(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5])
sys.dont_write_bytecode = True  # SHARED is not ours to write to
sys.path.insert(0, str(RENDERER))
os.environ.setdefault("WORLDS_BUILD", str(FOLDER.parent / "tracer"))

import causes  # noqa: E402
import effects  # noqa: E402
import truth  # noqa: E402
from worlds import World  # noqa: E402


def main():
    world = World("dev", INDEX)
    renderer, light, illumination = causes.traced(world, FOLDER / "light", FRAMES)
    records = [truth.frame_truth(renderer, frame) for frame in range(len(light))]
    for title, off in causes.variants(add=False):
        changed = without(world, off)
        if len(off) == 1 and changed.absent:
            continue
        make(title, lambda folder: causes.encode(changed, light, illumination, records, folder))
    truth.Annotator(world, records)  # the rectangles of the full clip; the next sets are those of other hands
    for k in range(SETS):
        labels = truth.annotations(world, truth.Annotator(world, records).out)
        make(f"rectangles {k}", lambda folder: mark_again(folder, labels))
    shutil.rmtree(FOLDER / "light")
    (FOLDER / "ready").touch()


def without(world, off):
    """The world with effects of sensor or video off, as `World(without=off)` would draw it again from its seed."""
    changed = copy.copy(world)
    changed.sensor, changed.annotation_random = copy.deepcopy((world.sensor, world.annotation_random))
    changed.without = off
    changed.absent = effects.switch_off(changed, off)
    return changed


def make(title, write):
    """Writes a scene's folder. A folder without its final name is unfinished."""
    final, unfinished = FOLDER / title.replace(" ", "-"), FOLDER / "unfinished"
    if not final.exists():
        shutil.rmtree(unfinished, ignore_errors=True)
        write(unfinished)
        unfinished.rename(final)


def mark_again(folder, labels):
    """The full clip with other rectangles."""
    full = FOLDER / "all-on"
    (folder / "contract").mkdir(parents=True)
    for name in ("video.mp4", "truth.json", "contract/camera_true.json"):
        (folder / name).hardlink_to(full / name)
    (folder / "contract" / "annotations.json").write_text(json.dumps(labels))


main()
