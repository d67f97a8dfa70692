// The browser as a box: Chromium with a camera that plays a clip records, as docs/feed.md has it, to the real service.
//
// Environment: as person.mjs, and TROCAR_CAMERA (a Y4M file that TROCAR_CAMERA_BOX can score); optional TROCAR_CAMERA_BOX
// (code, box-2).
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { launch, LOOKS } from './chromium.mjs';
import { ask, looks, need, patience, signIn, until, url } from './person.mjs';
import { Proxy } from './proxy.mjs';
import { tracesOf } from './watch.mjs';

const clip = need('TROCAR_CAMERA');
const box = process.env.TROCAR_CAMERA_BOX ?? 'box-2';
const CAMERA = ['--use-fake-device-for-media-stream', `--use-file-for-fake-video-capture=${clip}`];

let browser;
const traces = [];

before(async () => {
  browser = await launch([...CAMERA, '--use-fake-ui-for-media-stream']);
});

after(() => browser?.close());

/**
 * Runs `use(page)` with a page of its own that shows Record to somebody who has signed in. `at`: another address of the
 * service; `without`: what this browser is to lack; `prepare(context)`: done before it is opened.
 */
async function withPage(use, { by = browser, at = url, without = [], prepare } = {}) {
  const context = await by.newContext({ viewport: LOOKS[0].viewport, colorScheme: 'light' });
  try {
    await prepare?.(context);
    await context.addInitScript(names => names.forEach(name => delete window[name]), without);
    const page = await context.newPage();
    if (at === url) traces.push(tracesOf(page, url)); // What is cut throws as it should.
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

/** Runs `use(page, network)` with a page that reaches the service over a network that can be cut. */
async function withNetwork(use, options) {
  const network = await Proxy.before(url);
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

/** Waits until so many frames have been recorded. */
const recorded = (of, frames) =>
  of.waitForFunction(
    most => Number([...document.querySelectorAll('dt')].find(dt => dt.textContent === 'Recorded frames')
      ?.nextElementSibling.textContent) >= most,
    frames,
    { timeout: patience },
  );

/** Stops, and returns the session once the recording is whole. */
async function stop(of) {
  await button(of, 'Stop').click();
  const open = of.getByRole('link', { name: 'Open the session' });
  await open.waitFor({ timeout: patience });
  return (await open.getAttribute('href')).split('/').pop();
}

/** What the session is once it was scored. */
async function scored(of, id) {
  let told;
  const isOver = async () => !['receiving', 'queued', 'tracking'].includes((told = await ask(of, `sessions/${id}`)).status);
  await until(isOver, 'the score');
  return told;
}

/** The longest pause between two frames of a session that were tracked, s. */
async function longestPause(of, id) {
  const { columns } = await ask(of, `sessions/${id}/trajectory?format=json&kind=smoothed`);
  const times = [...new Set(columns.time_s)].sort((a, b) => a - b);
  return Math.max(...times.slice(1).map((time, at) => time - times[at]));
}

const MOST_PAUSE_S = 0.3;

/** Lets the page's recorder keep in mind the longest pause between two frames that it was given and had time for. */
const withPauses = context =>
  context.route('**/record/spool.js', async route => {
    const answer = await route.fetch();
    const noted = 'push({ time, isKey, payload }) {\n    self.pause = Math.max(self.pause ?? 0, time - (self.before ?? time)); self.before = time;';
    await route.fulfill({ response: answer, body: (await answer.text()).replace('push({ time, isKey, payload }) {', noted) });
  });

/** How long a session may pause, s: what a busy machine had no time for is no hole of ours. */
const mayPause = async of => Math.max(MOST_PAUSE_S, 0.1 + (await of.workers()[0].evaluate(() => self.pause)) / 90_000);

test('records, memory and order are those of the protocol', () =>
  withPage(async page => {
    assert.deepEqual(await page.evaluate(vectors), [
      '01010000000000020000000000000007000000000000627000000004b746a6e3ffd8ffd9',
      '010000000000000100000000000000000000000000000000000000016660498300',
      '02000000000000020000000000000008000000000000000000000009ce2d2426000000000000000b02',
    ]);
    // Memory that is full gives up whole groups, oldest first, and tells of them as gaps.
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
    // After an outage the newest key frame goes first and what was left out behind it.
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

test('a recording that the server has ended is whole only if nothing is kept here any more', () =>
  withPage(async page => {
    assert.equal(await page.evaluate(toldThatItEnded, [[0, 9]]), 'ended');
    assert.equal(await page.evaluate(toldThatItEnded, [[0, 5]]), 'shortened');
  }));

/** Runs in the page: how a feed of ten frames stands that comes back, of which the server has these, and is told that it is over. */
async function toldThatItEnded(durable) {
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
  spool.acknowledge(durable); // Before the line was cut.
  const feed = new Feed({ address: 'ws://nowhere', hello: {}, spool, onChange: () => {} });
  globalThis.WebSocket = browsers;
  sockets[0].onmessage({ data: JSON.stringify({ type: 'ended', session: 'the one' }) });
  return feed.line;
}

/** Runs in the page: ten frames a second, a key frame each second, ten bytes each; ten of them fill the memory. */
async function fill() {
  const { Spool } = await import('/record/spool.js');
  const spool = new Spool(100);
  const push = n => spool.push({ time: n * 9000, isKey: n % 10 === 0, payload: new Uint8Array(10) });
  for (let n = 0; n < 10; n++) push(n);
  const full = [spool.count, spool.lostTicks];
  for (let n = 10; n < 30; n++) push(n);
  const gaps = [spool.atOrAfter(0), spool.atOrAfter(10)];
  const lost = spool.lostTicks;
  gaps[1].isTold = true;
  spool.acknowledge([[0, 19]]); // The first was not told, so its frames had arrived.
  return {
    ...{ full, lost, lostAfterAll: spool.lostTicks, kept: spool.count, next: spool.atOrAfter(0).number },
    gaps: gaps.map(({ number, last }) => [number, last]),
  };
}

/** Runs in the page: in which order 200 frames go of which the server has ten. */
async function afterAnOutage() {
  const [{ Spool }, { Order }] = await Promise.all([import('/record/spool.js'), import('/record/order.js')]);
  const spool = new Spool();
  for (let n = 0; n < 200; n++) spool.push({ time: n * 3600, isKey: n % 25 === 0, payload: new Uint8Array(1) });
  spool.acknowledge([[0, 9]]);
  const order = new Order();
  const numbers = [];
  for (let item = order.next(spool, true); item; item = order.next(spool, true)) numbers.push(item.number);
  return numbers;
}

for (const [codec, without] of [
  ['H.264', []],
  ['JPEG', ['VideoEncoder']],
  ['H.264', ['MediaStreamTrackProcessor']],
])
  test(`what the camera sees is followed, kept and scored: ${[codec, ...without].join(' without ')}`, () =>
    withPage(
      async page => {
        const pictures = name => without.length || looks(page, `record-${name}`);
        await page.waitForFunction(() => document.querySelector('.own video')?.videoWidth > 0);
        await page.getByText('does not let its exposure').waitFor();
        await pictures('aim');
        await start(page);
        assert.match(await fact(page, 'Picture'), new RegExp(`640 × 360, ${codec}`));
        await page.locator('.seen', { hasText: /Seen on \d+%/ }).nth(1).waitFor({ timeout: patience });
        await recorded(page, 125);
        await page.waitForFunction(isDrawn, null, { timeout: patience });
        await pictures('runs');
        const most = await mayPause(page);
        const session = await stop(page);
        await pictures('ended');
        const told = await scored(page, session);
        assert.equal(told.status, 'done', JSON.stringify(told.error));
        assert.equal(told.box.code, box);
        assert.ok(told.video.frames >= 125, `${told.video.frames} frames`);
        assert.ok((await longestPause(page, session)) < most, 'without a hole');
        for (const { tool, observed, missing } of told.quality.tools)
          assert.ok(missing < 0.25 * (observed + missing), `${tool}: ${observed} observed, ${missing} missing`);
      },
      { without, prepare: withPauses },
    ));

/** Runs in the page: does the overlay show anything? */
function isDrawn() {
  const canvas = document.querySelector('.own canvas');
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  return data.filter((value, at) => at % 4 === 3 && value > 0).length > 100;
}

test('a cut costs nothing: it is told, recording goes on, and the session has no hole', () =>
  withNetwork(async (page, network) => {
    await start(page);
    await recorded(page, 40);
    network.cut();
    await page.getByText('Connection lost').first().waitFor();
    await page.getByText(/[3-9] s are kept here/).waitFor();
    await looks(page, 'record-cut');
    network.mend();
    await page.locator('.pill', { hasText: 'Connected' }).waitFor({ timeout: patience });
    const frames = Number(await fact(page, 'Recorded frames'));
    await recorded(page, frames + 50);
    const most = await mayPause(page);
    const told = await scored(page, await stop(page));
    assert.ok(told.video.frames >= frames + 50, `${told.video.frames} frames`);
    assert.ok((await longestPause(page, told.id)) < most, 'no hole where the cut was');
  }, { prepare: withPauses }));

test('an outage that is longer than memory lasts costs what is said to be lost, and no more', () => {
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
      await lost.waitFor({ timeout: patience });
      await recorded(page, Number(await fact(page, 'Recorded frames')) + 40);
      await looks(page, 'record-lost');
      network.mend();
      await page.locator('.pill', { hasText: 'Connected' }).waitFor({ timeout: patience });
      await page.locator('.seen', { hasText: 'Seen on' }).first().waitFor({ timeout: patience }); // Followed again.
      const [frames, seconds] = [Number(await fact(page, 'Recorded frames')), parseInt(await lost.innerText())];
      const told = await scored(page, await stop(page));
      assert.ok(told.video.frames >= frames - 25 * (seconds + 1), `${told.video.frames} frames, ${seconds} s lost`);
      const pause = await longestPause(page, told.id);
      assert.ok(Math.abs(pause - seconds) < 1.6, `${seconds} s are said to be lost, ${pause} s are missing`);
    },
    { prepare },
  );
});

test('a recording goes on while other pages are shown, and the box is taken for everybody else', () =>
  withPage(async page => {
    await start(page);
    await withPage(async other => {
      await button(other, 'Start recording').click();
      await other.getByText('This box is being recorded already').waitFor();
      await looks(other, 'record-busy');
    });
    const asked = page.waitForEvent('dialog');
    const leaving = page.reload({ timeout: 5_000 }).catch(() => {}); // Which does not come about.
    assert.equal((await asked).type(), 'beforeunload', 'whoever leaves is asked');
    await (await asked).dismiss();
    await leaving;

    const frames = Number(await fact(page, 'Recorded frames'));
    await page.getByRole('link', { name: 'Tasks', exact: true }).click();
    await page.locator('main h1', { hasText: 'Tasks' }).waitFor();
    await page.getByRole('link', { name: /^Record/ }).click();
    await recorded(page, frames + 50);
    assert.equal((await scored(page, await stop(page))).status, 'done');
  }));

test('a camera that is not allowed is said to be so, with what to do', async () => {
  const by = await launch([...CAMERA, '--use-fake-ui-for-media-stream=deny']);
  const refused = async page => {
    await button(page, 'Turn on the camera').click();
    await page.getByRole('alert').getByText('The camera is not allowed here').waitFor();
    assert.ok(await button(page, 'Start recording').isDisabled());
    await looks(page, 'record-denied');
  };
  await withPage(refused, { by }).finally(() => by.close());
});

test('nothing was asked of another server, nothing broke the policy, nothing was thrown', () => {
  assert.ok(traces.length > 4);
  for (const seen of traces) assert.deepEqual(seen(), { foreign: [], broken: [] });
});
