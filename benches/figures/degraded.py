"""Copies of V1–V5 that cameras and other programs have degraded: the stated region must hold, or the clip must be refused.

Judged with the true camera by SHARED/worlds/judge.py. The rendered clips have their chroma in the middle between two pixels and
do not signal it, so players assume left; the copy `chroma left` has it where players assume it.
"""
import hashlib
import json
import shutil
import subprocess

from programs import Goal, Part, run, table

H264 = ["-c:v", "libx264", "-crf"]
FROM_RGB = "scale=out_color_matrix=bt709:out_range=limited,format=yuv420p"
SIGNALLED = ["-colorspace", "bt709", "-color_range", "tv"]
TO_LEFT = ("scale=in_h_chr_pos=128:in_v_chr_pos=128,format=yuv444p,"
           "scale=out_h_chr_pos=0:out_v_chr_pos=128,format=yuv420p")
# A JPEG is BT.601 with full range.
COPIES = {
    "as rendered": None,
    "coded again, crf 28": [*H264, 28],
    "sharpened": ["-vf", "unsharp=5:5:1.2", *H264, 18],
    "S-shaped tone curve": ["-vf", f"curves=all='0/0 0.25/0.17 0.5/0.5 0.75/0.83 1/1',{FROM_RGB}", *H264, 18, *SIGNALLED],
    "saturation × 1.5": ["-vf", "eq=saturation=1.5", *H264, 18],
    "blurred, σ 1.5 px": ["-vf", "gblur=sigma=1.5", *H264, 18],
    "MJPEG, q 8": ["-vf", "scale=out_color_matrix=bt601:out_range=full,format=yuvj420p", "-c:v", "mjpeg", "-q:v", 8],
    "denoised": ["-vf", "hqdn3d=6:6:10:10", *H264, 20],
    "chroma left": ["-vf", TO_LEFT, *H264, 16, "-chroma_sample_location", "left"],
}
MIN_SHARE = 88  # per cent


def measure(bench, scenes):
    results = {}
    for scene in scenes.rendered:
        out = bench.folder(f"degraded/{scene.name}")
        folders = [judgeable(scene, out, name, how) for name, how in COPIES.items()]
        results[scene.name] = dict(zip(COPIES, bench.judged(folders, out)))
    about = (f"Degraded copies of {', '.join(results)}, with the true camera: share of the rows inside their stated 95 % region; "
             "the 3-D RMS error; and the stated 3-D σ. *Sharpened*: `unsharp=5:5:1.2`. *Denoised*: `hqdn3d=6:6:10:10`. *Chroma "
             "left*: the chroma resampled to where players assume it; in the rendered clips it is half a pixel to the right.")
    rows = [[name, *(cell(of_scene[name]) for of_scene in results.values())] for name in COPIES]
    return Part(goals(results), [about, table(["copy", *results], rows)])


def judgeable(scene, out, name, how):
    """The copy in the layout of SHARED/worlds. It is encoded again only if the clip, the command or ffmpeg has changed."""
    made_of = hashlib.sha256(scene.video.read_bytes() + repr(how).encode() + ffmpeg_version()).hexdigest()[:12]
    folder = out / f"copy-{made_of}"
    (folder / "contract").mkdir(parents=True, exist_ok=True)
    shutil.copyfile(scene.true_camera, folder / "contract" / "camera_true.json")
    annotations = json.loads(scene.annotations.read_text())
    (folder / "contract" / "annotations.json").write_text(json.dumps({**annotations, "video": "../video.mp4"}))
    (folder / "truth.json").write_text(json.dumps(truth(scene, name)))
    if not (folder / "video.mp4").exists():
        unfinished = folder / "unfinished.mp4"
        if how is None:
            shutil.copyfile(scene.video, unfinished)
        else:
            run(["ffmpeg", "-v", "error", "-y", "-i", scene.video, *how, "-an", unfinished])
        unfinished.rename(folder / "video.mp4")
    return folder


def ffmpeg_version():
    return subprocess.run(["ffmpeg", "-version"], check=True, capture_output=True).stdout


def truth(scene, name):
    """The scene's truth with the keys that the judge reads."""
    frames = json.loads(scene.truth.read_text())["frames"]
    camera = json.loads(scene.true_camera.read_text())
    for tool in (tool for frame in frames for tool in frame["tools"]):
        tool["visible_fraction"] = tool["tip_end_visible_fraction"] = tool["visible"]
        tool["tip_in_image"] = all(0 <= at < size for at, size in zip(tool["tip_px"], (camera["width"], camera["height"])))
    tools = [{"tool": tool["tool"], "marker": tool["tool"]} for tool in frames[0]["tools"]]
    return {"scene": f"{scene.name}, {name}", "view": "", "tools": tools, "frames": frames}


def goals(results):
    copies = [of_scene[name] for of_scene in results.values() for name in COPIES if COPIES[name]]
    kept = [copy for copy in copies if not copy["refused"]]
    silent = [copy["scene"] for copy in kept if copy["silent"]]
    low = [f"{copy['scene']} {100 * inside(copy):.0f}" for copy in kept if 100 * inside(copy) < MIN_SHARE]
    refused = [copy["scene"] for copy in copies if copy["refused"]]
    least = min((inside(copy) for copy in kept), default=0)
    return [Goal("degraded copies, not refused: rows inside the stated 95 % region, each copy", f"≥ {MIN_SHARE} %",
                 f"{len(kept) - len(low)} of {len(kept)}, lowest {100 * least:.0f} %" + listed(low), bool(kept) and not low),
            Goal("degraded copies: silently wrong", "0 of those not refused",
                 f"{len(silent)} of {len(kept)}" + listed(silent) + f"; {len(refused)} refused" + listed(refused), not silent)]


def listed(names):
    return f" ({' · '.join(names)})" if names else ""


def inside(copy):
    """Share of a copy's rows inside their stated 95 % region; 0 without rows."""
    return mean_of_rows(copy, lambda tool: tool["in95"])


def mean_of_rows(copy, figure):
    """Mean of a tool's figure over the rows of all tools."""
    tools = [tool for tool in copy["tools"] if tool["rows"]]
    return sum(figure(tool) * tool["rows"] for tool in tools) / max(1, sum(tool["rows"] for tool in tools))


def cell(copy):
    if not any(tool["rows"] for tool in copy["tools"]):
        return copy["verdict"]
    rms, sigma = (mean_of_rows(copy, figure) ** 0.5
                  for figure in (lambda tool: tool["rms"] ** 2, lambda tool: (tool["width"] * tool["rms"]) ** 2))
    mark = " (refused)" if copy["refused"] else " **silently wrong**" if copy["silent"] else ""
    return f"{100 * inside(copy):.0f} %, {rms:.2f} mm, σ {sigma:.1f} mm{mark}"
