#!/usr/bin/env python3
"""The README's table of figures: calibrate → track → evaluate, on every scene with a known answer, beside the OpenCV peer.

Usage: benches/figures.py TROCAR SHARED WORK [--readme README.md]

TROCAR is the release binary, SHARED the folder with `scenes/`, `peer/`, WORK a folder for results. Everything is done
as a user would: photos and annotations in, nothing else. CPU is user and system time, medians of RUNS interleaved rounds.
Own stages: for Trocar what `--timings` counts on its tracking thread, colour samples and start included; for the peer
its own count less that of decoding alone (`ffmpeg -threads 2 -f null`), its colour table made beforehand. Whole run: of
Trocar's process everything, of the peer's all but its start.
"""
import json
import os
import resource
import statistics
import subprocess
import sys
import venv
from pathlib import Path

RUNS = 3
VISIBLE = 0.4
PEER_NEEDS = ["opencv-python-headless<5", "numpy", "scipy", "numba"]
BEGIN, END = "<!-- figures: made by `make figures`; do not edit by hand -->", "<!-- /figures -->"


def main():
    trocar, shared, work = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    readme = Path(sys.argv[sys.argv.index("--readme") + 1]) if "--readme" in sys.argv else None
    work.mkdir(parents=True, exist_ok=True)
    python = peer_python(work / "peer-venv")
    table = ["| scene | calibration RMS | tip found | false tracks | swaps | lateral RMS | depth RMS | 3-D RMS "
             "| inside stated 95 % | peer 3-D RMS | own CPU a frame | peer's | ratio | whole run |",
             "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"]
    for scene in scenes(shared, work, python):
        print(f"… {scene['name']}", file=sys.stderr)
        table.append(row(scene, trocar, shared, work, python))
    text = "\n".join(table)
    print(text)
    if readme:
        before, rest = readme.read_text().split(BEGIN)
        after = rest.split(END)[1]
        readme.write_text(f"{before}{BEGIN}\n\n{text}\n\n{note()}\n\n{END}{after}")


def peer_python(folder):
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
        subprocess.run([folder / "bin" / "pip", "install", "-q", *PEER_NEEDS], check=True)
    return python


def scenes(shared, work, python):
    """The rendered scenes and one clip of the peer's own generator, each with the photos that its camera took."""
    for name, photos in (("V1", "V"), ("V2", "W"), ("V3", "V"), ("V4", "V"), ("V5", "V")):
        folder = shared / "scenes" / name
        yield dict(name=name, video=folder / "video.mp4", annotations=folder / "annotations.json",
                   truth=folder / "truth.json", photos=sorted((shared / "scenes" / "calib" / photos).glob("*.jpg")))
    clip = work / "peer-clip"
    if not (clip / "truth.json").exists():
        subprocess.run([python, shared / "peer" / "make_clip.py", "--out", clip], check=True, stdout=sys.stderr)
    yield dict(name="peer, 1080p", video=clip / "clip.mp4", annotations=clip / "annotations.json",
               truth=clip / "truth.json", photos=sorted((clip / "boards").glob("*.jpg")))


def row(scene, trocar, shared, work, python):
    out = work / scene["name"].replace(", ", "-")
    out.mkdir(exist_ok=True)
    camera = out / "camera.json"
    run([trocar, "calibrate", "--quiet", "--board", "9x6", "--square-mm", "21", "--out", camera, *scene["photos"]])
    ours = [trocar, "track", "--quiet", "--camera", camera, "--annotations", scene["annotations"],
            "--out", out / "track.csv", scene["video"]]
    peer = [python, shared / "peer" / "opencv_tracker.py", "--video", scene["video"], "--camera", camera,
            "--annotations", scene["annotations"], "--out", out / "peer.csv", "--timings", out / "peer.json",
            "--lut", out / "peer-lut.npy"]
    decode = ["ffmpeg", "-v", "error", "-threads", "2", "-i", scene["video"], "-f", "null", "-"]
    run(peer)  # fills its colour table once; setting it up is no per-frame cost
    cpu = {"decode": [], "own": [], "whole": [], "peer": []}
    for _ in range(RUNS):
        cpu["decode"].append(1e3 * cpu_of(decode))
        cpu["whole"].append(1e3 * cpu_of(ours + ["--timings", out / "timings.json"]))
        cpu["own"].append(json.loads((out / "timings.json").read_text())["own_cpu_ms_per_frame"])
        run(peer)
        cpu["peer"].append(json.loads((out / "peer.json").read_text())["cpu_ms_per_frame"])
    frames = json.loads((out / "peer.json").read_text())["frames"]
    decode_ms, own_ms, whole_ms, peer_whole_ms = (statistics.median(cpu[key]) for key in ("decode", "own", "whole", "peer"))
    whole_ms /= frames
    peer_ms = peer_whole_ms - decode_ms / frames
    mine = evaluated(trocar, out / "track.csv", scene["truth"])
    other = evaluated(trocar, out / "peer.csv", scene["truth"])
    rms_px = json.loads(camera.read_text())["rms_px"]
    return (f"| {scene['name']} | {rms_px:.3f} px | {100 * mine['coverage']:.1f} % | {mine['false_tracks']} | {mine['swaps']} "
            f"| {rms(mine, 'lateral')} | {rms(mine, 'depth')} | {rms(mine, '3d')} | {inside(mine)} "
            f"| {rms(other, '3d')} ({100 * other['coverage']:.0f} %) | {own_ms:.2f} ms | {peer_ms:.1f} ms "
            f"| 1/{peer_ms / own_ms:.1f} | {whole_ms:.1f}, {peer_whole_ms:.1f} ms |")


def evaluated(trocar, track, truth):
    """All tools together, on the frames where at least VISIBLE of the band can be seen."""
    text = subprocess.run([trocar, "evaluate", "--json", track, truth], check=True, capture_output=True, text=True).stdout
    everything = json.loads(text)["all"]
    level = next(level for level in everything["levels"] if level["visible_from"] == VISIBLE)
    return {**level, "false_tracks": everything["false_tracks"]}


def rms(level, direction):
    """What the program never found has no error."""
    return f"{level['errors_mm'][direction]['rms']:.2f} mm" if level["errors_mm"] else "–"


def inside(level):
    return f"{100 * level['inside_95']['3d']:.0f} %" if level["inside_95"] else "–"


def run(command):
    subprocess.run([str(c) for c in command], check=True, stdout=subprocess.DEVNULL)


def cpu_of(command):
    """CPU seconds, user and system, of one run of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run(command)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def note():
    return (f"All from photos and annotations alone. *Tip found*: share of the frames where ≥ {100 * VISIBLE:.0f} % of the band "
            "is visible. *Inside stated 95 %*: share of the tips that lie within the error bar stated for them (95 would be "
            "honest). The peer is an OpenCV program of the same method; its share of found tips is in brackets. Own "
            "CPU: all stages but decoding, start and colour samples included (for the peer left out). Whole run: Trocar's "
            "and the peer's CPU a frame with decoding; Trocar decodes up to the last marked frame twice, the peer's second "
            f"time is not counted. {os.cpu_count()} cores, medians of {RUNS} interleaved runs.")


if __name__ == "__main__":
    main()
