"""Peak memory of tracking at 1080p: of a short clip, and of the same clip over and over."""
from dataclasses import replace

from programs import Goal, Part, frames_and_mbit_s, run

MOST_MIB = 160
FLAT = 1.1  # what a long recording may need, in units of a short one
LOOPS = 15  # of 20 s each: what grows with every frame shows within minutes


def measure(bench, scenes):
    short = scenes.peer_1080p
    camera = bench.calibrate(short)
    long = looped(short, 2 if bench.quick else LOOPS)
    peaks = [bench.track(scene, camera, "memory.csv")[1].peak_mib for scene in (short, long)]
    minutes = [frames_and_mbit_s(scene.video)[0] / 25 / 60 for scene in (short, long)]
    long.video.unlink()
    reached = " · ".join(f"{mib:.0f} MiB over {m:.1f} min" for mib, m in zip(peaks, minutes))
    met = max(peaks) <= MOST_MIB and peaks[1] <= FLAT * peaks[0]
    return Part([Goal("peak memory of `trocar track`, 1080p", f"≤ {MOST_MIB} MiB, flat", reached, met)])


def looped(scene, times):
    """The same clip so many times, without encoding it anew."""
    video = scene.out / "looped.mp4"
    run(["ffmpeg", "-v", "error", "-y", "-stream_loop", times - 1, "-i", scene.video, "-c", "copy", video])
    return replace(scene, video=video)
