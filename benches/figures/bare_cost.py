"""Cost of tracking two tools without tape at 1080p: CPU time of the tracker's own thread, as counted by `--timings`, without
decoding."""
import json
from statistics import median

from programs import ROUNDS, Goal, Part, decoding, frames_and_mbit_s, run

MOST_MS = 2.0


def measure(bench, scenes):
    scene = scenes.bare_1080p
    camera = bench.calibrate(scene)
    frames, mbit_s = frames_and_mbit_s(scene.video)
    took = {key: [] for key in ("track", "middle", "high", "own", "once", "decode", "whole")}
    for _ in range(bench.rounds(ROUNDS)):
        decoded = run(decoding(scene.video))
        timings = scene.out / "timings.json"
        _, tracked = bench.track(scene, camera, options=["--timings", timings])
        stages = json.loads(timings.read_text())
        for key, of in (("track", "mean"), ("middle", "median"), ("high", "p95")):
            took[key].append(stages["track_cpu_ms_per_frame"][of])
        took["own"].append(stages["own_cpu_ms_per_frame"])
        took["once"].append(1e-3 * sum(stages["once_cpu_ms"].values()))
        took["decode"].append(1e3 * decoded.cpu_s / frames)
        took["whole"].append(1e3 * tracked.cpu_s / frames)
    track, middle, high, own, once, decode, whole = (median(values) for values in took.values())
    reached = (f"{track:.2f} ms (median frame {middle:.2f}, 95 % of the frames ≤ {high:.2f}); besides, {once:.1f} s once a "
               f"recording. All stages but decoding, over these {frames} frames: {own:.1f} ms a frame; whole run: "
               f"{whole:.1f} ms; decoding alone: {decode:.1f} ms at {mbit_s:.1f} Mbit/s")
    name = "own CPU per frame of the tracker, 1080p, two bare tools"
    return Part([Goal(name, f"≤ {MOST_MS:.1f} ms", reached, track <= MOST_MS)])
