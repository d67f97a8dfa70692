// Uploads one file with tus-js-client, as any web page or program does: node upload.mjs ENDPOINT TOKEN FILE TRAINEE
// TASK BOX
import { createReadStream, statSync } from "node:fs";
import { basename } from "node:path";
import { Upload } from "tus-js-client";

const [endpoint, token, file, trainee, task, box] = process.argv.slice(2);
let session = null;
const upload = new Upload(createReadStream(file), {
  endpoint,
  uploadSize: statSync(file).size,
  chunkSize: 64 * 1024 * 1024, // required for a stream: a retry can go back by at most this much
  headers: { Authorization: `Bearer ${token}` },
  metadata: { filename: basename(file), trainee, task, box },
  retryDelays: [50, 100, 200, 200, 400, 400, 800, 800],
  onAfterResponse: (_request, response) => {
    session = response.getHeader("Trocar-Session") ?? session;
  },
  onError: (error) => {
    console.error(String(error));
    process.exitCode = 1;
  },
  onSuccess: () => console.log(session),
});
upload.start();
