// Records in the browser: Chromium, whose camera plays a clip, sends to the real service with the protocol of
// docs/feed.md.
//
// Environment: as person.mjs, and TROCAR_CAMERA (a Y4M file that TROCAR_CAMERA_BOX can score). Optional:
// TROCAR_CAMERA_BOX (the code of a box, default box-2).
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { launch, LOOKS } from './chromium.mjs';
import { getJson, checkLooks, requiredEnv, timeoutMs, signIn, waitUntil, url } from './person.mjs';
import { CuttableProxy } from './cuttable_proxy.mjs';
import { watchForFaults } from './page_faults.mjs';

const cameraClip = requiredEnv('TROCAR_CAMERA');
const box = process.env.TROCAR_CAMERA_BOX ?? 'box-2';
const CAMERA = ['--use-fake-device-for-media-stream', `--use-file-for-fake-video-capture=${cameraClip}`];

let browser;
const pageFaults = [];

before(async () => {
  browser = await launch([...CAMERA, '--use-fake-ui-for-media-stream']);
});

after(() => browser?.close());

/**
 * Opens the Record page for a signed-in user in a context of its own, and runs `use(page)`. `inBrowser`: the browser;
 * `at`: the address of the service; `without`: browser APIs to remove; `prepare(context)` runs before the page is
 * opened.
 */
async function withPage(use, { inBrowser = browser, at = url, without = [], prepare } = {}) {
  const context = await inBrowser.newContext({ viewport: LOOKS[0].viewport, colorScheme: 'light' });
  try {
    await prepare?.(context);
    await context.addInitScript(names => names.forEach(name => delete window[name]), without);
    const page = await context.newPage();
    if (at === url) pageFaults.push(watchForFaults(page, url)); // Behind a cut proxy errors are expected.
    await page.goto(`${at}/record?box=${box}`);
    await signIn(page);
    await page.locator('main h1', { hasText: 'Record' }).waitFor();
    for (const label of ['Trainee', 'Task']) {
      const chooser = page.getByLabel(label, { exact: true });
      if (!(await chooser.inputValue())) await chooser.selectOption({ index: 1 });
    }
    await use(page);
  } finally {
    await context.close();
  }
}

/** Runs `use(page, network)` with a page that reaches the service through a proxy that can be cut. */
async function withNetwork(use, options) {
  const network = await CuttableProxy.inFrontOf(url);
  try {
    await withPage(page => use(page, network), { ...options, at: network.url });
  } finally {
    network.close();
  }
}

const button = (of, name) => of.getByRole('button', { name, exact: true });
const fact = async (of, name) => (await of.locator('dt', { hasText: name }).locator('+ dd').innerText()).trim();

async function start(of) {
  await button(of, 'Start recording').click();
  await of.locator('.pill', { hasText: 'Connected' }).waitFor({ timeout: 10_000 }).catch(async error => {
    assert.fail(`${error.message}: ${await of.locator('main').innerText()}`);
  });
}

/** Waits until this many frames have been recorded. */
const recorded = (of, frames) =>
  of.waitForFunction(
    limit => Number([...document.querySelectorAll('dt')].find(dt => dt.textContent === 'Recorded frames')
      ?.nextElementSibling.textContent) >= limit,
    frames,
    { timeout: timeoutMs },
  );

/** Stops the recording, waits until the service has all of it, and returns the session's id. */
async function stop(of) {
  await button(of, 'Stop').click();
  const open = of.getByRole('link', { name: 'Open the session' });
  await open.waitFor({ timeout: timeoutMs });
  return (await open.getAttribute('href')).split('/').pop();
}

/** Waits until the session is scored or has failed, and returns it. */
async function waitForResult(of, id) {
  let result;
  const isFinished = async () =>
    !['receiving', 'queued', 'tracking'].includes((result = await getJson(of, `sessions/${id}`)).status);
  await waitUntil(isFinished, 'the score');
  return result;
}

/** The longest pause between two tracked frames of a session, s. */
async function longestPause(of, id) {
  const { columns } = await getJson(of, `sessions/${id}/trajectory?format=json&kind=smoothed`);
  const times = [...new Set(columns.time_s)].sort((a, b) => a - b);
  return Math.max(...times.slice(1).map((time, at) => time - times[at]));
}

const MAX_PAUSE_S = 0.3;

/**
 * Patches the page's recorder to store the longest pause between two frames that it received, in ticks, as
 * `self.pause`.
 */
const measurePauses = context =>
  context.route('**/record/spool.js', async route => {
    const answer = await route.fetch();
    const noted = 'push({ time, isKey, payload }) {\n    self.pause = Math.max(self.pause ?? 0, time - (self.before ?? time)); self.before = time;';
    await route.fulfill({ response: answer, body: (await answer.text()).replace('push({ time, isKey, payload }) {', noted) });
  });

/** The longest pause that a session may have, s. Pauses that the recorder itself saw on a busy machine are allowed. */
const maxPause = async of => Math.max(MAX_PAUSE_S, 0.1 + (await of.workers()[0].evaluate(() => self.pause)) / 90_000);

test('record bytes, memory limit and sending order follow the protocol', () =>
  withPage(async page => {
    assert.deepEqual(await page.evaluate(vectors), [
      '01010000000000020000000000000007000000000000627000000004b746a6e3ffd8ffd9',
      '010000000000000100000000000000000000000000000000000000016660498300',
      '02000000000000020000000000000008000000000000000000000009ce2d2426000000000000000b02',
    ]);
    // When the memory is full, the oldest groups of frames are dropped and reported as gaps.
    const [first, second] = [
      [0, 9],
      [10, 19],
    ];
    assert.deepEqual(await page.evaluate(fill), {
      full: [10, 0],
      gaps: [first, second],
      lost: 180_000,
      lostAfterAll: 90_000,
      kept: 10,
      next: 20,
    });
    // After an outage the newest key frame and the frames after it are sent first, then the older ones.
    const range = (from, end) => Array.from({ length: end - from }, (_, at) => from + at);
    assert.deepEqual(await page.evaluate(afterAnOutage), [...range(175, 200), ...range(10, 175)]);
  }));

/** Runs in the page: the test vectors of docs/feed.md. */
async function vectors() {
  const { frameRecord, gapRecord } = await import('/record/records.js');
  const bytes = (...payload) => Uint8Array.from(payload);
  return [
    frameRecord(2, { number: 7, time: 25200, isKey: true, payload: bytes(0xff, 0xd8, 0xff, 0xd9) }),
    frameRecord(1, { number: 0, time: 0, isKey: false, payload: bytes(0) }),
    gapRecord(2, [8, 11]),
  ].map(record => [...record].map(byte => byte.toString(16).padStart(2, '0')).join(''));
}

test('a recording that the server has ended is complete only if no unsent frames are left in the browser', () =>
  withPage(async page => {
    assert.equal(await page.evaluate(feedStateAfterEnd, [[0, 9]]), 'ended');
    assert.equal(await page.evaluate(feedStateAfterEnd, [[0, 5]]), 'shortened');
  }));

/**
 * Runs in the page: the state of a feed of ten frames that reconnects and receives `ended`. `durable`: the frames that
 * the server had acknowledged before.
 */
async function feedStateAfterEnd(durable) {
  const [{ Feed }, { Spool }] = await Promise.all([import('/record/feed.js'), import('/record/spool.js')]);
  const sockets = [];
  const browsers = globalThis.WebSocket;
  globalThis.WebSocket = class {
    bufferedAmount = 0;
    constructor() {
      sockets.push(this);
    }
    send() {}
    close() {}
  };
  const spool = new Spool();
  for (let n = 0; n < 10; n++) spool.push({ time: n * 9000, isKey: n === 0, payload: new Uint8Array(10) });
  spool.acknowledge(durable); // Before the connection was cut.
  const feed = new Feed({ address: 'ws://nowhere', hello: {}, spool, onChange: () => {} });
  globalThis.WebSocket = browsers;
  sockets[0].onmessage({ data: JSON.stringify({ type: 'ended', session: 'the one' }) });
  return feed.connection;
}

/**
 * Runs in the page: pushes ten frames a second of ten bytes each, with a key frame each second. Ten frames fill the
 * memory.
 */
async function fill() {
  const { Spool } = await import('/record/spool.js');
  const spool = new Spool(100);
  const push = n => spool.push({ time: n * 9000, isKey: n % 10 === 0, payload: new Uint8Array(10) });
  for (let n = 0; n < 10; n++) push(n);
  const full = [spool.count, spool.lostTicks];
  for (let n = 10; n < 30; n++) push(n);
  const gaps = [spool.atOrAfter(0), spool.atOrAfter(10)];
  const lost = spool.lostTicks;
  gaps[1].isSent = true;
  spool.acknowledge([[0, 19]]); // The first gap was not sent, so its frames had arrived.
  return {
    ...{ full, lost, lostAfterAll: spool.lostTicks, kept: spool.count, next: spool.atOrAfter(0).number },
    gaps: gaps.map(({ number, last }) => [number, last]),
  };
}

/** Runs in the page: returns the sending order of 200 frames if the server already has the first ten. */
async function afterAnOutage() {
  const [{ Spool }, { SendOrder }] = await Promise.all([import('/record/spool.js'), import('/record/send_order.js')]);
  const spool = new Spool();
  for (let n = 0; n < 200; n++) spool.push({ time: n * 3600, isKey: n % 25 === 0, payload: new Uint8Array(1) });
  spool.acknowledge([[0, 9]]);
  const order = new SendOrder();
  const numbers = [];
  for (let item = order.next(spool, true); item; item = order.next(spool, true)) numbers.push(item.number);
  return numbers;
}

for (const [codec, without] of [
  ['H.264', []],
  ['JPEG', ['VideoEncoder']],
  ['H.264', ['MediaStreamTrackProcessor']],
])
  test(`a recording from the camera is tracked live, stored and scored: ${[codec, ...without].join(' without ')}`, () =>
    withPage(
      async page => {
        const pictures = name => without.length || checkLooks(page, `record-${name}`);
        await page.waitForFunction(() => document.querySelector('.own video')?.videoWidth > 0);
        await page.getByText('of this camera cannot be locked').waitFor();
        await pictures('aim');
        await start(page);
        assert.match(await fact(page, 'Picture'), new RegExp(`640 × 360, ${codec}`));
        await page.locator('.seen', { hasText: /Seen on \d+%/ }).nth(1).waitFor({ timeout: timeoutMs });
        await recorded(page, 125);
        await page.waitForFunction(isDrawn, null, { timeout: timeoutMs });
        await pictures('runs');
        const limit = await maxPause(page);
        const session = await stop(page);
        await pictures('ended');
        const result = await waitForResult(page, session);
        assert.equal(result.status, 'done', JSON.stringify(result.error));
        assert.equal(result.box.code, box);
        assert.ok(result.video.frames >= 125, `${result.video.frames} frames`);
        assert.ok((await longestPause(page, session)) < limit, 'no gap in the recording');
        for (const { tool, observed, missing } of result.quality.tools)
          assert.ok(missing < 0.25 * (observed + missing), `${tool}: ${observed} observed, ${missing} missing`);
      },
      { without, prepare: measurePauses },
    ));

/** Runs in the page: true if the overlay has more than 100 drawn pixels. */
function isDrawn() {
  const canvas = document.querySelector('.own canvas');
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  return data.filter((value, at) => at % 4 === 3 && value > 0).length > 100;
}

test('after a cut connection the page says so and keeps recording, and the session has no gap', () =>
  withNetwork(async (page, network) => {
    await start(page);
    await recorded(page, 40);
    network.cut();
    await page.getByText('Connection lost').first().waitFor();
    await page.getByText(/[3-9] s are stored in this browser/).waitFor();
    await checkLooks(page, 'record-cut');
    network.restore();
    await page.locator('.pill', { hasText: 'Connected' }).waitFor({ timeout: timeoutMs });
    const frames = Number(await fact(page, 'Recorded frames'));
    await recorded(page, frames + 50);
    const limit = await maxPause(page);
    const result = await waitForResult(page, await stop(page));
    assert.ok(result.video.frames >= frames + 50, `${result.video.frames} frames`);
    assert.ok((await longestPause(page, result.id)) < limit, 'no gap at the time of the cut');
  }, { prepare: measurePauses }));

test('after an outage that overflows the memory, no more is missing than the page reports as lost', () => {
  const small = async route => {
    const answer = await route.fetch();
    await route.fulfill({ response: answer, body: (await answer.text()).replace('128 * 2 ** 20', '400_000') });
  };
  const prepare = context => context.route('**/record/spool.js', small);
  return withNetwork(
    async (page, network) => {
      await start(page);
      await recorded(page, 60);
      network.cut();
      const lost = page.getByText(/^\d+ s of the recording are lost$/);
      await lost.waitFor({ timeout: timeoutMs });
      await recorded(page, Number(await fact(page, 'Recorded frames')) + 40);
      await checkLooks(page, 'record-lost');
      network.restore();
      await page.locator('.pill', { hasText: 'Connected' }).waitFor({ timeout: timeoutMs });
      // Live tracking works again.
      await page.locator('.seen', { hasText: 'Seen on' }).first().waitFor({ timeout: timeoutMs });
      const [frames, seconds] = [Number(await fact(page, 'Recorded frames')), parseInt(await lost.innerText())];
      const result = await waitForResult(page, await stop(page));
      assert.ok(result.video.frames >= frames - 25 * (seconds + 1), `${result.video.frames} frames, ${seconds} s lost`);
      const pause = await longestPause(page, result.id);
      assert.ok(Math.abs(pause - seconds) < 1.6, `the page reports ${seconds} s as lost, ${pause} s are missing`);
    },
    { prepare },
  );
});

test('recording continues while the user opens other pages, and others cannot record with the same box', () =>
  withPage(async page => {
    await start(page);
    await withPage(async other => {
      await button(other, 'Start recording').click();
      await other.getByText('This box is being recorded already').waitFor();
      await checkLooks(other, 'record-busy');
    });
    const confirmation = page.waitForEvent('dialog');
    const leaving = page.reload({ timeout: 5_000 }).catch(() => {}); // The dialog prevents the reload.
    assert.equal((await confirmation).type(), 'beforeunload', 'the page asks before it is left');
    await (await confirmation).dismiss();
    await leaving;

    const frames = Number(await fact(page, 'Recorded frames'));
    await page.getByRole('link', { name: 'Tasks', exact: true }).click();
    await page.locator('main h1', { hasText: 'Tasks' }).waitFor();
    await page.getByRole('link', { name: /^Record/ }).click();
    await recorded(page, frames + 50);
    assert.equal((await waitForResult(page, await stop(page))).status, 'done');
  }));

test('a recording of a closed tab is interrupted, and its page scores what arrived at once', () => {
  let session;
  return withPage(async page => {
    await start(page);
    await recorded(page, 100);
    session = (await getJson(page, 'sessions?status=receiving')).items[0].id;
  }).then(() =>
    withPage(async page => {
      const open = page.locator('.notice', { hasText: /The recording is interrupted at 0:0[3-9]/ }).getByRole('link');
      await open.waitFor({ timeout: timeoutMs });
      await checkLooks(page, 'record-interrupted');
      await open.click();
      await page.waitForURL(`**/sessions/${session}`);
      await page.getByText('The recording is interrupted').first().waitFor();
      await checkLooks(page, 'session-interrupted');
      await button(page, 'Score what arrived').click();
      const result = await waitForResult(page, session);
      assert.ok(result.video.frames >= 75, `${result.video.frames} frames`);
    }),
  );
});

test('if the browser denies the camera, the page says so and what to do', async () => {
  const inBrowser = await launch([...CAMERA, '--use-fake-ui-for-media-stream=deny']);
  const refused = async page => {
    await button(page, 'Turn on the camera').click();
    await page.getByRole('alert').getByText('The camera is not allowed here').waitFor();
    assert.ok(await button(page, 'Start recording').isDisabled());
    await checkLooks(page, 'record-denied');
  };
  await withPage(refused, { inBrowser }).finally(() => inBrowser.close());
});

test('no page sent a request to another origin, violated the security policy or threw an error', () => {
  assert.ok(pageFaults.length > 4);
  for (const faults of pageFaults) assert.deepEqual(faults(), { foreign: [], errors: [] });
});
