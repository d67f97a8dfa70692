// Recordings that players show in an unusual way, in a real Chromium with the real service: a picture that begins later
// than its file, and pixels that are not square. The overlay belongs to the frame that the browser shows, and lies on it.
//
// Environment: as person.mjs, and TROCAR_CLIP (a simulated recording; its camera.json and annotations.json lie beside it,
// and TROCAR_BOX can score it). Optional: TROCAR_BOX, TROCAR_TRAINEE, TROCAR_TASK (names).
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import { after, before, test } from 'node:test';

import { launch } from './chromium.mjs';
import { person, requiredEnv, waitUntil, url } from './person.mjs';

const clip = requiredEnv('TROCAR_CLIP');
const RATE_HZ = 25;
const folder = mkdtempSync(join(tmpdir(), 'presentation-'));

let browser;
let page, getJson, create;

before(async () => {
  browser = await launch();
  const user = await person(browser);
  ({ page, getJson, create } = user);
  await page.goto(`${url}/sessions`);
  await user.signIn();
  await user.heading('Sessions').waitFor();
});

after(() => {
  rmSync(folder, { recursive: true });
  return browser?.close();
});

const named = async (list, name) => (await getJson(list)).items.find(one => one.name === name) ?? (await getJson(list)).items[0];
const beside = name => JSON.parse(readFileSync(join(dirname(clip), name), 'utf8'));

/** Makes a copy of the clip with FFmpeg; the arguments come before and after its name. */
function copyOf(name, before, after) {
  const path = join(folder, name);
  execFileSync('ffmpeg', ['-loglevel', 'error', ...before.split(' ').filter(Boolean), '-i', clip, ...after.split(' '), path]);
  return path;
}

/**
 * Sends a request of the page: `bytes` as they are, or as the parts of a form where they are named. Returns the JSON answer.
 */
async function send(method, path, type, content) {
  const isForm = !Buffer.isBuffer(content);
  const parts = Object.entries(isForm ? content : { body: content }).map(([name, bytes]) => [name, bytes.toString('base64')]);
  return page.evaluate(
    async ([method, at, type, isForm, parts]) => {
      const bytes = parts.map(([name, coded]) => [name, Uint8Array.from(atob(coded), letter => letter.charCodeAt(0))]);
      const form = new FormData();
      for (const [name, part] of bytes) form.append(name, new Blob([part]), name);
      const answer = await fetch(at, isForm ? { method, body: form } : { method, headers: { 'Content-Type': type }, body: bytes[0][1] });
      if (!answer.ok) throw new Error(`${at}: ${answer.status} ${await answer.text()}`);
      return answer.json();
    },
    [method, `/api/v1/${path}`, type, isForm, parts],
  );
}

/** Sends a recording and waits for its score; returns the session's id. */
async function score(path, box) {
  const [trainee, task] = [await named('trainees', process.env.TROCAR_TRAINEE), await named('tasks', process.env.TROCAR_TASK)];
  const query = `trainee=${trainee.code}&task=${task.code}&box=${box.code}&filename=${path.split('/').pop()}`;
  const type = path.endsWith('webm') ? 'video/webm' : 'video/mp4';
  const { id } = await send('POST', `sessions?${query}`, type, readFileSync(path));
  await waitUntil(async () => ['done', 'failed'].includes((await getJson(`sessions/${id}`)).status), 'the score');
  const { status, error } = await getJson(`sessions/${id}`);
  assert.equal(status, 'done', JSON.stringify(error));
  return id;
}

const video = act => page.evaluate(act);
const isStill = () => page.waitForFunction(() => !document.querySelector('video').seeking);
const shownFrame = async () => Number(/frame (\d+)/.exec(await page.locator('.transport .clock').innerText())[1]);

async function openSession(id, search = '') {
  await page.goto(`${url}/sessions/${id}${search}`);
  await page.locator('.plots canvas').first().waitFor();
  await page.waitForFunction(() => document.querySelector('video')?.readyState >= 2);
}

/** Moves the video as a browser's own controls would, to this time on the file's clock. */
async function moveVideo(time) {
  await page.evaluate(at => (document.querySelector('video').currentTime = at), time);
  await isStill();
}

for (const [name, before, after, startsAt] of [
  ['late.mp4', '-itsoffset 1', '-c copy', 1],
  ['late.webm', '-f lavfi -i sine=duration=7 -itsoffset 1.5', '-map 0 -map 1 -c:v libvpx -deadline realtime -cpu-used 8 -b:v 6M -c:a libopus', 1.5],
  ['late_parts.mp4', '-itsoffset 0.4', '-c copy -movflags frag_keyframe+delay_moov', 0.4],
])
  test(`${name}: the page shows each frame with its own overlay`, async () => {
    const id = await score(copyOf(name, before, after), await named('boxes', process.env.TROCAR_BOX));
    const { starts_at_s: stated } = (await getJson(`sessions/${id}`)).video.clock;
    assert.ok(Math.abs(stated - startsAt) < 0.1, `starts at ${stated} s`);
    await openSession(id);
    for (const frame of [0, 50, 120]) {
      await moveVideo(stated + (frame + 0.4) / RATE_HZ);
      await page.waitForFunction(wanted => document.querySelector('.transport .clock').textContent.endsWith(`frame ${wanted}`), frame);
    }
    await page.locator('main').press('.');
    await isStill();
    assert.equal(await shownFrame(), 121);
    const inVideo = await video(() => document.querySelector('video').currentTime);
    assert.equal(Math.floor((inVideo - stated) * RATE_HZ), 121, `the video is at ${inVideo} s`);
    await openSession(id, '?t=2');
    await page.waitForFunction(at => Math.abs(document.querySelector('video').currentTime - at) < 0.05, stated + 2);
  });

test('pixels that are not square: the overlay lies on the tools, and a frame is taken as it is stored', async () => {
  const [from, to] = [1280, 960];
  const narrow = copyOf('narrow.mp4', '', `-vf scale=${to}:720,setsar=4/3 -c:v libx264 -preset veryfast -crf 14`);
  const share = to / from;
  const camera = beside('camera.json');
  // A pixel's centre at x lies at (x + 0.5) · share - 0.5 in the narrow picture.
  const narrowCamera = { ...camera, width: to, fx: camera.fx * share, cx: (camera.cx + 0.5) * share - 0.5 };
  const marked = beside('annotations.json');
  const squeeze = mark => ({ ...mark, x: Math.ceil(mark.x * share), w: Math.max(1, Math.floor(mark.w * share) - 1) });
  const labels = marked.labels.map(squeeze);
  await create('boxes', { name: 'Narrow pixels', view: 'top' });
  const box = await named('boxes', 'Narrow pixels');
  await send('PUT', `boxes/${box.code}/camera`, 'application/json', Buffer.from(JSON.stringify(narrowCamera)));
  const { job } = await send('POST', `boxes/${box.code}/palettes`, 'form', {
    annotations: Buffer.from(JSON.stringify({ ...marked, labels })),
    video: readFileSync(narrow),
  });
  await waitUntil(async () => ['done', 'failed', 'quarantined'].includes((await getJson(`jobs/${job}`)).state), 'the colours');
  const id = await score(narrow, box);
  assert.equal((await getJson(`sessions/${id}`)).video.width, to);
  await openSession(id);
  const [, ...otherLayers] = await page.locator('.layers button').all();
  for (const layer of otherLayers) if ((await layer.getAttribute('aria-pressed')) === 'true') await layer.click();
  const { columns } = await getJson(`sessions/${id}/trajectory?format=json`);
  const rows = columns.frame.map((frame, row) => ({ frame, x: columns.tip_u_px[row], y: columns.tip_v_px[row], state: columns.state[row] }));
  const observed = rows.filter(row => row.frame === 50 && row.x !== null && row.state === 'observed');
  assert.ok(observed.length > 0, 'a tool is measured on frame 50');
  await moveVideo(50.4 / RATE_HZ);
  await page.waitForFunction(() => document.querySelector('.transport .clock').textContent.endsWith('frame 50'));
  const tips = observed.map(({ x, y }) => [(x + 0.5) / to, (y + 0.5) / 720]);
  const isDrawn = await page.evaluate(places => {
    const [screen, canvas] = [document.querySelector('video'), document.querySelector('.screen canvas[aria-hidden]')];
    const scale = Math.min(canvas.width / screen.videoWidth, canvas.height / screen.videoHeight);
    const [width, height] = [screen.videoWidth * scale, screen.videoHeight * scale];
    const at = ([x, y]) => [(canvas.width - width) / 2 + x * width, (canvas.height - height) / 2 + y * height].map(Math.round);
    return places.map(place => canvas.getContext('2d').getImageData(...at(place), 1, 1).data[3] > 0);
  }, tips);
  assert.deepEqual(isDrawn, tips.map(() => true), 'the dot of each tip lies on its place in the shown picture');
  const size = await page.evaluate(async () => {
    const { frameOf } = await import('/setup/pictures.js');
    const { width, height } = await createImageBitmap(await frameOf(document.querySelector('video')));
    return [width, height];
  });
  assert.deepEqual(size, [to, 720]);
});
