"""Uploads one file with tus-py-client: upload.py ENDPOINT TOKEN FILE TRAINEE TASK BOX"""
import os
import sys

import requests
from tusclient import client

endpoint, token, file, trainee, task, box = sys.argv[1:]
tus = client.TusClient(endpoint, headers={"Authorization": f"Bearer {token}"})
uploader = tus.uploader(
    file,
    chunk_size=8 * 1024 * 1024,
    metadata={"filename": os.path.basename(file), "trainee": trainee, "task": task, "box": box},
    retries=20,
    retry_delay=0.1,
)
uploader.upload()
done = requests.head(uploader.url, headers={"Authorization": f"Bearer {token}", "Tus-Resumable": "1.0.0"}, timeout=60)
print(done.headers["Trocar-Session"])
