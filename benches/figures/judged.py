"""Tracks scenes and judges them with SHARED/worlds/judge.py. Usage: judged.py WORLDS TROCAR OUT SCENE…

Each SCENE is a folder in the layout of SHARED/worlds. OUT gets `judged.json`, and a folder a scene with its track.
"""
import json
import sys
from pathlib import Path

sys.dont_write_bytecode = True  # SHARED is not ours to write to
worlds, trocar, out, *scenes = sys.argv[1:]
sys.path.insert(0, worlds)

import judge  # noqa: E402

results = []
for scene in map(Path, scenes):
    folder = Path(out) / scene.name
    folder.mkdir(parents=True, exist_ok=True)
    result = judge.judge(scene, trocar, None, [], folder)
    if result["verdict"] not in (*judge.NOT_REFUSED, "refused"):
        sys.exit(f"{scene}: {result['error'] or 'no verdict'}")
    results.append({**result, "folder": str(scene), "refused": result["verdict"] == "refused"})
(Path(out) / "judged.json").write_text(json.dumps(results))
