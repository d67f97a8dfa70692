"""What tracking costs: CPU of its own stages beside the peer's, and wall time beside decoding alone.

CPU is user and system time. Own stages: for Trocar what `--timings` counts on its tracking thread, colour samples and start
included; for the peer its own count less that of decoding alone, its colour table made beforehand. Whole run: of Trocar's process
everything, of the peer's all but its start. Programs take turns, so that a busy minute hits them all.
"""
import json
from statistics import median

from programs import ROUNDS, Goal, Part, decoding, frames_and_mbit_s, run, table

HEAD = ["scene", "bit rate", "own CPU a frame", "peer's", "ratio", "decoding alone", "whole run", "peer's", "wall ÷ decoding alone"]


def measure(bench, scenes):
    chosen = [*scenes.rendered, scenes.peer_1080p]
    results = {scene.name: result(bench, scene) for scene in chosen}
    about = ("Cost, CPU milliseconds a frame. *Own*: all stages but decoding, start and colour samples included (for the peer left out). "
             "*Decoding alone*: `ffmpeg -threads 2 -i clip -f null -`. *Whole run*: with decoding; Trocar decodes up to the "
             "last marked frame twice, the peer's second time is not counted. *Wall*: `trocar track` ÷ that ffmpeg.")
    rows = [[name, f"{r['mbit_s']:.1f} Mbit/s", *(f"{r[key]:.2f} ms" for key in ("own", "peer")), f"1/{r['peer'] / r['own']:.1f}",
             *(f"{r[key]:.1f} ms" for key in ("decode", "whole", "peer_whole")), f"{r['wall']:.2f}"] for name, r in results.items()]
    return Part(goals(results[scenes.peer_1080p.name]), [about, table(HEAD, rows)])


def result(bench, scene):
    camera = bench.calibrate(scene)
    bench.peer_track(scene, camera)  # fills its colour table once; setting it up is no per-frame cost
    frames, mbit_s = frames_and_mbit_s(scene.video)
    took = {"decode": [], "own": [], "whole": [], "peer_whole": [], "decode_wall": [], "track_wall": []}
    for _ in range(bench.rounds(ROUNDS)):
        decoded = run(decoding(scene.video))
        timings = scene.out / "timings.json"
        _, tracked = bench.track(scene, camera, options=["--timings", timings])
        _, peer = bench.peer_track(scene, camera)
        took["decode"].append(1e3 * decoded.cpu_s / frames)
        took["decode_wall"].append(decoded.wall_s)
        took["own"].append(json.loads(timings.read_text())["own_cpu_ms_per_frame"])
        took["whole"].append(1e3 * tracked.cpu_s / frames)
        took["track_wall"].append(tracked.wall_s)
        took["peer_whole"].append(peer["cpu_ms_per_frame"])
    middle = {key: median(values) for key, values in took.items()}
    return {**middle, "mbit_s": mbit_s, "peer": middle["peer_whole"] - middle["decode"],
            "wall": middle["track_wall"] / middle["decode_wall"]}


def goals(at_1080p):
    own, peer, wall, mbit_s = (at_1080p[key] for key in ("own", "peer", "wall", "mbit_s"))
    return [Goal("own CPU a frame, 1080p, two tools (thesis: 460 ms)", "≤ 0.5 ms", f"{own:.2f} ms", own <= 0.5),
            Goal("the peer's own CPU ÷ that", "≥ 25", f"{peer / own:.1f} ({peer:.1f} ms)", peer >= 25 * own),
            Goal("wall time of `trocar track` ÷ `ffmpeg -threads 2 -f null`, 1080p", "≤ 1.15",
                 f"{wall:.2f} at {mbit_s:.1f} Mbit/s", wall <= 1.15)]
