"""Cost of tracking: CPU time of its own stages compared with the peer's, and wall time compared with decoding alone.

CPU time is user plus system time. Own stages: for Trocar the time of its tracking thread as counted by `--timings`, including
colour samples and start; for the peer its own count minus the time of decoding alone, with its colour table made beforehand.
Whole run: for Trocar the whole process; for the peer all but its start. The programs run alternately, so that a busy minute
affects all of them.
"""
import json
from statistics import median

from programs import ROUNDS, Goal, Part, decoding, frames_and_mbit_s, run, table

HEAD = ["scene", "bit rate", "own CPU per frame", "peer's", "ratio", "decoding alone", "whole run", "peer's", "wall ÷ decoding alone",
        "one pass"]


def measure(bench, scenes):
    chosen = [*scenes.rendered, scenes.peer_1080p]
    results = {scene.name: result(bench, scene) for scene in chosen}
    about = ("Cost, CPU milliseconds per frame. *Own*: all stages except decoding; for Trocar including start and colour samples, for "
             "the peer without them. *Decoding alone*: `ffmpeg -threads 2 -i clip -f null -`. *Whole run*: including decoding. Before "
             "tracking, Trocar decodes from key frames to the marked frames; the peer's first pass is not counted. A frame can only be decoded after "
             "every frame that it refers to, back to the last key frame: with marks spread over a clip, that is about half of it. The colours of a box are "
             "stored, so the service needs no such pass. *Wall*: wall time of "
             "`trocar track` ÷ wall time of this ffmpeg. *One pass*: the same without decoding for the marked frames.")
    rows = [[name, f"{r['mbit_s']:.1f} Mbit/s", *(f"{r[key]:.2f} ms" for key in ("own", "peer")), f"1/{r['peer'] / r['own']:.1f}",
             *(f"{r[key]:.1f} ms" for key in ("decode", "whole", "peer_whole")),
             *(f"{r[key]:.2f}" for key in ("wall", "one_pass"))] for name, r in results.items()]
    return Part(goals(results[scenes.peer_1080p.name]), [about, table(HEAD, rows)])


def result(bench, scene):
    camera = bench.calibrate(scene)
    bench.peer_track(scene, camera)  # fills its colour table once, because this is not a cost per frame
    frames, mbit_s = frames_and_mbit_s(scene.video)
    took = {key: [] for key in ("decode", "own", "whole", "peer_whole", "decode_wall", "track_wall", "one_pass_wall")}
    for _ in range(bench.rounds(ROUNDS)):
        decoded = run(decoding(scene.video))
        timings = scene.out / "timings.json"
        _, tracked = bench.track(scene, camera, options=["--timings", timings])
        _, peer = bench.peer_track(scene, camera)
        took["decode"].append(1e3 * decoded.cpu_s / frames)
        took["decode_wall"].append(decoded.wall_s)
        stages = json.loads(timings.read_text())
        took["own"].append(stages["own_cpu_ms_per_frame"])
        took["one_pass_wall"].append(tracked.wall_s - 1e-3 * stages["wall_ms_of"]["decode_marked_frames"])
        took["whole"].append(1e3 * tracked.cpu_s / frames)
        took["track_wall"].append(tracked.wall_s)
        took["peer_whole"].append(peer["cpu_ms_per_frame"])
    middle = {key: median(values) for key, values in took.items()}
    return {**middle, "mbit_s": mbit_s, "peer": middle["peer_whole"] - middle["decode"],
            "wall": middle["track_wall"] / middle["decode_wall"], "one_pass": middle["one_pass_wall"] / middle["decode_wall"]}


def goals(at_1080p):
    own, peer, wall, one_pass, mbit_s, decode = (at_1080p[key] for key in ("own", "peer", "wall", "one_pass", "mbit_s", "decode"))
    alone = f"decoding alone {decode:.1f} ms"
    return [Goal("own CPU per frame, 1080p, two tools (thesis: 460 ms)", "≤ 0.5 ms", f"{own:.2f} ms; {alone}", own <= 0.5),
            Goal("the peer's own CPU ÷ Trocar's own CPU", "≥ 25", f"{peer / own:.1f} ({peer:.1f} ms)", peer >= 25 * own),
            Goal("wall time of `trocar track` ÷ `ffmpeg -threads 2 -f null`, 1080p", "≤ 1.15",
                 f"{wall:.2f} at {mbit_s:.1f} Mbit/s; {one_pass:.2f} without the pass over marked frames; lowest possible 1.00: {alone} "
                 "of CPU per frame", wall <= 1.15)]
