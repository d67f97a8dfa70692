"""A bad tape colour and hard light. The error must be at most twice that of the good case, or the clip must be refused with a
reason; wrong tracks without a warning are a failure."""
import subprocess

from programs import Goal, Part

CASES = {"purple": "purple on red and blue", "hard": "hard light"}


def measure(bench, scenes):
    seconds = 3 if bench.quick else 10
    good = scenes.peer_clip("bad-case reference", "720p", seconds)
    camera = bench.calibrate(good)
    reference = judged(bench, good, camera)
    return Part([goal(bench, scenes.peer_clip(f"bad-case {look}", "720p", seconds, look), camera, name, reference)
                 for look, name in CASES.items()])


def judged(bench, scene, camera):
    track, _ = bench.track(scene, camera)
    return bench.evaluated(track, scene.truth)


def goal(bench, scene, camera, name, reference):
    wanted = "error ≤ 2 × the good case, or refused"
    try:
        level = judged(bench, scene, camera)
    except subprocess.CalledProcessError as refusal:
        return Goal(name, wanted, f"refused: {refusal.stderr.strip()}", True)
    if not all(tool["errors_mm"] for tool in level["tools"]):
        return Goal(name, wanted, "a tool was never found, without a reason", False)
    ratios = {bad["tool"]: rms(bad) / rms(good) for bad, good in zip(level["tools"], reference["tools"])}
    wrong = level["false_tracks"] + level["swaps"]
    reached = (" · ".join(f"{tool} {ratio:.1f} ×" for tool, ratio in ratios.items())
               + f"; {100 * level['coverage']:.1f} % found (good case {100 * reference['coverage']:.1f}), {wrong} false or swapped")
    return Goal(name, wanted, reached, max(ratios.values()) <= 2 and wrong == 0)


def rms(tool):
    return tool["errors_mm"]["3d"]["rms"]
