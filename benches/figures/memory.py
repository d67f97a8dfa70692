"""Peak memory of tracking at 1080p: a short clip, and an hour that repeats this clip."""
from dataclasses import replace

from programs import Goal, Part, frames_and_mbit_s, run

MOST_MIB = 160
FLAT = 1.1  # limit for the long recording, relative to the short one
LONG_S = 3600  # decoding and tracking takes 8 minutes of CPU time


def measure(bench, scenes):
    short = scenes.peer_1080p
    camera = bench.calibrate(short)
    short_s = frames_and_mbit_s(short.video)[0] / 25
    long = looped(short, 2 if bench.quick else round(LONG_S / short_s))
    peaks = [bench.track(scene, camera, "memory.csv")[1].peak_mib for scene in (short, long)]
    long_s = frames_and_mbit_s(long.video)[0] / 25
    long.video.unlink()
    reached = " · ".join(f"{mib:.0f} MiB over {s / 60:.1f} min" for mib, s in zip(peaks, (short_s, long_s)))
    met = max(peaks) <= MOST_MIB and peaks[1] <= FLAT * peaks[0]
    return Part([Goal("peak memory of `trocar track`, 1080p", f"≤ {MOST_MIB} MiB, flat", reached, met)])


def looped(scene, times):
    """The same clip repeated, without re-encoding. An hour takes 1.1 GB of disk until it has been tracked."""
    video = scene.out / "looped.mp4"
    run(["ffmpeg", "-v", "error", "-y", "-stream_loop", times - 1, "-i", scene.video, "-c", "copy", video])
    return replace(scene, video=video)
