"""A bad colour and hard light: at most twice the good case's error, or refused with the reason, and never silently wrong."""
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
    usual = reference["errors_mm"]["3d"]["rms"]
    error = level["errors_mm"]["3d"]["rms"] if level["errors_mm"] else None
    if error is None:
        return Goal(name, wanted, "nothing found", None)
    wrong = level["false_tracks"] + level["swaps"]
    reached = f"{error / usual:.1f} × ({error:.2f} against {usual:.2f} mm), {100 * level['coverage']:.1f} % found, {wrong} false or swapped"
    return Goal(name, wanted, reached, error <= 2 * usual and wrong == 0)
