// Somebody who has never calibrated sets up a new box through the page alone: board, photos (one of them bad), camera,
// instruments, colours painted with the mouse, the box's token. The box is ready in the end, and REST says the same.
//
// Environment: as person.mjs, and TROCAR_SETUP (a simulated scene with clip.mp4, annotations.json, boards/ and bad/, photos
// without a whole board).
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';

import { strokeOf } from '../../static/setup/marks.js';
import { violationsOf } from './access.mjs';
import { launch, LOOKS } from './chromium.mjs';
import { need, patience, person, url } from './person.mjs';

const scene = need('TROCAR_SETUP');
const marks = JSON.parse(readFileSync(join(scene, 'annotations.json'), 'utf8'));
const truth = JSON.parse(readFileSync(join(scene, 'truth.json'), 'utf8'));
const NAME = `Box of a beginner ${Date.now()}`;
const A4_PX = (297 / 25.4) * 96;

let browser;
let page, traces, ask, looks, signIn;
let box;

before(async () => {
  browser = await launch();
  ({ page, traces, ask, looks, signIn } = await person(browser, { prefix: 'setup-' }));
  page.setDefaultTimeout(patience);
});

after(() => browser?.close());

const files = folder => readdirSync(join(scene, folder)).sort().map(name => join(scene, folder, name));

/** The step that is shown, in every look, open to everybody. */
async function pictures(name) {
  const faults = [];
  await looks(name, async look => faults.push(...(await violationsOf(page)).map(violation => `${look.name}: ${violation}`)));
  assert.deepEqual(faults, []);
}

const step = title => page.getByRole('navigation', { name: 'Steps of setting up' }).getByRole('link', { name: title });
const state = async title => (await step(title).locator('.state').innerText()).trim();

async function goTo(title) {
  await step(title).click();
  await page.locator('.setup-step h2', { hasText: title }).waitFor();
}

test('a stroke’s rectangles lie within the brush’s reach, inside the picture, and none over another', () => {
  const size = { width: 200, height: 120 };
  const path = [[-4, 10], [60, 50], [190, 118], [230, 119]];
  const along = path.slice(1).flatMap(([x, y], i) =>
    Array.from({ length: 401 }, (_, n) => [path[i][0] + ((x - path[i][0]) * n) / 400, path[i][1] + ((y - path[i][1]) * n) / 400]));
  for (const diameter of [3, 7, 24]) {
    const painted = new Set();
    for (const { x, y, w, h } of strokeOf(path, diameter, size))
      for (let row = y; row < y + h; row++)
        for (let column = x; column < x + w; column++) {
          assert.ok(column >= 0 && column < size.width && row >= 0 && row < size.height);
          assert.ok(!painted.has(row * size.width + column), 'twice');
          painted.add(row * size.width + column);
          const off = Math.min(...along.map(([u, v]) => Math.hypot(u - column - 0.5, v - row - 0.5)));
          assert.ok(off <= diameter / 2 + diameter / 4 + 1, `${column}, ${row} is ${off} px beside the path`);
        }
    assert.ok(painted.has(50 * size.width + 60), 'where the brush went is painted');
  }
});

test('a new box is made, and its row leads to the first step', async () => {
  await page.goto(`${url}/boxes`);
  await signIn();
  await page.getByRole('button', { name: 'Add a box' }).click();
  await page.fill('dialog input[name=name]', NAME);
  await page.getByRole('button', { name: 'Save' }).click();
  await page.getByRole('link', { name: `Set up ${NAME} step by step` }).click();
  await page.locator('.setup-step h2', { hasText: 'Print the board' }).waitFor();
  box = new URL(page.url()).pathname.split('/')[2];
  assert.equal(await state('Photos'), 'to do');
  assert.equal(await state('Tape colours'), 'to do');
});

test('the board is printed alone and in true millimetres, and a measured ruler tells its squares', async () => {
  await page.emulateMedia({ media: 'print' });
  await page.setViewportSize({ width: Math.ceil(A4_PX), height: 800 });
  const sheet = await page.locator('.board-sheet svg').boundingBox();
  const inked = await page.evaluate(() => document.querySelector('.top').getClientRects().length);
  await page.emulateMedia({ media: 'screen' });
  await page.setViewportSize(LOOKS[0].viewport);
  assert.ok(Math.abs(sheet.width - A4_PX) < 0.5, `297 mm are ${sheet.width} px`);
  assert.equal(inked, 0, 'nothing else is on paper');
  await page.getByLabel('Printed ruler').click();
  await page.keyboard.type('98.5'); // Key by key: the first that makes a length must not turn the page.
  assert.equal(await page.getByLabel('Side of a square').inputValue(), '20.685');
  await page.getByLabel('Printed ruler').fill('100');
  await page.getByLabel('I have measured it').check();
  assert.equal(await state('Print the board'), 'done');
  await pictures('1-board');
});

test('each photo is told at once to be good, or why not and where', async () => {
  await goTo('Photos of the board');
  const [good, bad] = [files('boards'), files('bad')];
  await page.getByLabel('Or choose photos').setInputFiles([bad[0]]);
  const card = page.locator('.photo').first();
  await card.locator('.pill', { hasText: 'not usable' }).waitFor();
  assert.match(await card.innerText(), /Cut off at the (left|right|upper|lower)/);
  await page.getByText('In none of the photos was the board found').waitFor();
  await page.getByLabel('Or choose photos').setInputFiles([...good, ...bad.slice(1)]);
  await page.locator('.photo.good').nth(good.length - 1).waitFor();
  await page.waitForFunction(() => !document.querySelector('.photo.busy'));
  assert.equal(await page.locator('.photo.good').count(), good.length);
  assert.equal(await page.locator('.photo.good').first().locator('circle').count(), 54, 'corners are drawn');
  assert.equal(await page.locator('.photo.warn').count(), bad.length);
  const told = await page.locator('.photo.warn').allInnerTexts();
  assert.ok(told.some(text => text.includes('Too dark')), told.join('\n'));
  await page.getByText(/Corners in \d+ of 48 parts/).waitFor();
  await pictures('2-photos');
});

test('the camera is calibrated from the good photos, and each photo’s residual is the one that REST tells', async () => {
  await goTo('Calibrate');
  const good = files('boards').length;
  await page.getByRole('button', { name: `Calibrate from ${good} photos` }).click();
  await page.locator('[data-calibrated]').waitFor();
  const camera = await ask(`boxes/${box}/camera`);
  assert.equal(camera.photos.length, good);
  assert.ok(camera.rms_px < 1, `${camera.rms_px} px`);
  const rows = page.locator('.residuals tbody tr');
  assert.equal(await rows.count(), good);
  for (const [index, photo] of camera.photos.entries()) {
    const shown = Number((await rows.nth(index).locator('td').first().innerText()).replace('−', '-'));
    assert.ok(Math.abs(shown - photo.rms_px) <= 0.05 * photo.rms_px, `${photo.file}: ${shown}, ${photo.rms_px}`);
    assert.equal(await rows.nth(index).getAttribute('data-used'), String(photo.used));
  }
  assert.ok(camera.photos.some(({ used, reason }) => !used && /bent/.test(reason)), 'the bent boards are left out');
  assert.equal(await state('Calibrate'), 'done');
  await pictures('3-calibration');
});

test('instruments are described by their tape and sizes', async () => {
  await goTo('Instruments');
  for (const [index, tool] of marks.tools.entries()) {
    await page.getByRole('button', { name: 'Add an instrument' }).click();
    const form = page.locator('fieldset.instrument').nth(index);
    await form.getByLabel('Colour of the tape').fill(tool.colour ?? tool.tool);
    await form.getByLabel('Diameter over the tape').fill(String(tool.diameter_mm));
    await form.getByLabel('Length of the tape').fill(String(tool.band_length_mm));
  }
  await page.getByLabel('Camera’s view').selectOption('top');
  assert.equal(await state('Instruments'), 'done');
  await pictures('4-tools');
});

/** Frames of the clip on which every tape is marked, so that a person would paint there. */
const tapes = marks.tools.map(tool => tool.colour ?? tool.tool);
const framesWith = label => [...new Set(marks.labels.filter(one => one.label === label).map(one => one.frame))];

/** The moment in the middle of a frame. */
const moment = frame => (frame + 0.5) / truth.fps;

async function takeFrame(second) {
  const before = await page.locator('.frames li').count();
  await page.locator('.setup-step video').evaluate(async (video, at) => {
    const sought = new Promise(done => video.addEventListener('seeked', done, { once: true }));
    video.currentTime = at;
    await sought;
    await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
  }, second);
  await page.getByRole('button', { name: 'Take this frame' }).click();
  await page.locator('.frames li').nth(before).waitFor();
}

/** A stroke of the mouse through the middle of a rectangle of the frame. */
async function paint({ x, y, w, h }) {
  const canvas = page.locator('.painter canvas.paint');
  await canvas.scrollIntoViewIfNeeded();
  const [size, { width, height }] = [await canvas.boundingBox(), await canvas.evaluate(({ width, height }) => ({ width, height }))];
  const at = (u, v) => [size.x + (u * size.width) / width, size.y + (v * size.height) / height];
  await page.mouse.move(...at(x + w * 0.3, y + h / 2));
  await page.mouse.down();
  await page.mouse.move(...at(x + w * 0.7, y + h / 2), { steps: 4 });
  await page.mouse.up();
}

/** How much of a rectangle of a frame its mask covers, 0..1. */
const covered = (frame, rectangle) =>
  page.locator(`.frames li[data-frame="${frame}"] canvas.mask`).evaluate((mask, { x, y, w, h }) => {
    const cell = 2;
    const pixels = mask.getContext('2d').getImageData(x / cell, y / cell, Math.max(1, w / cell), Math.max(1, h / cell)).data;
    let inked = 0;
    for (let i = 3; i < pixels.length; i += 4) inked += pixels[i] > 0;
    return inked / (pixels.length / 4);
  }, rectangle);

test('strokes on some frames show the tape on frames on which nobody painted', async () => {
  await goTo('Tape colours');
  await page.getByLabel('A recording of the box').setInputFiles(join(scene, 'clip.mp4'));
  await page.waitForFunction(() => document.querySelector('.setup-step video')?.readyState >= 2);
  const chosen = [...new Set(tapes.flatMap(tape => framesWith(tape).slice(0, 2)).concat(framesWith('background')[0]))];
  const unpainted = [...new Set(tapes.map(tape => framesWith(tape).at(-1)))].filter(frame => !chosen.includes(frame));
  assert.ok(unpainted.length > 0 && chosen.length + unpainted.length <= 8, 'frames to compare with');
  for (const frame of [...chosen, ...unpainted]) await takeFrame(moment(frame));
  await page.getByText('Paint on a tape to see it.').waitFor();
  const brush = page.locator('.size input');
  for (const [index, frame] of chosen.entries()) {
    await page.getByRole('button', { name: `Paint on frame ${index + 1}`, exact: true }).click();
    for (const one of marks.labels.filter(({ frame: own }) => own === frame)) {
      if (!tapes.includes(one.label) && one.label !== 'background') continue;
      await page.locator('.choice').first().getByRole('button', { name: one.label === 'background' ? 'not tape' : one.label }).click();
      await brush.fill(String(Math.max(3, Math.round(0.6 * Math.min(one.w, one.h)))));
      await paint(one);
    }
  }
  await page.getByText('Only the tapes should be.').waitFor(); // Of all strokes: while masks are of fewer, the page says that it asks.
  for (const [index, frame] of unpainted.entries())
    for (const one of marks.labels.filter(label => label.frame === frame)) {
      const share = await covered(chosen.length + index, one);
      if (tapes.includes(one.label)) assert.ok(share > 0.5, `${one.label} on frame ${frame}: ${share}`);
      if (one.label === 'background') assert.ok(share < 0.2, `background of frame ${frame}: ${share}`);
    }
  assert.ok((await page.locator('.setup-step table tbody tr').count()) >= tapes.length + 1, 'the confusion is told');
  await pictures('5-colours');
});

test('a stroke can be undone, and a point painted by keyboard alone', async () => {
  const strokes = async () => Number(/\d+/.exec(await page.locator('.painter ~ .row [role=status]').innerText())?.[0] ?? 0);
  const before = await strokes();
  await page.locator('.painter').focus();
  await page.keyboard.press('Shift+ArrowRight');
  await page.keyboard.press('ArrowUp');
  await page.keyboard.press('Space');
  await page.waitForFunction(n => document.querySelector('.painter ~ .row [role=status]').textContent.startsWith(String(n)), before + 1);
  await page.getByRole('button', { name: 'Undo' }).click();
  assert.equal(await strokes(), before);
});

test('the colours are learned from what was painted, and the box is ready', async () => {
  await page.getByRole('button', { name: 'Learn the colours' }).click();
  await page.locator('[data-palette="1"]').waitFor();
  const { palette, calibration, tools, view } = await ask(`boxes/${box}`);
  assert.ok(palette === 1 && calibration, 'REST says the same');
  assert.equal(view, 'top');
  assert.deepEqual(tools.map(({ diameter_mm }) => diameter_mm).sort(), marks.tools.map(tool => tool.diameter_mm).sort());
  const [{ annotations, verdicts }] = (await ask(`boxes/${box}/palette`)).items;
  assert.ok(annotations.labels.some(({ stroke }) => stroke > 0), 'strokes are known as such');
  assert.deepEqual(verdicts.map(({ grade }) => grade).filter(grade => grade === 'bad'), []);
  await page.getByText('This box is ready').waitFor();
  assert.equal(await state('Tape colours'), 'done');
  await pictures('6-learned');
});

test('the token of the box is shown once, with the command that uses it and a code to read it by', async () => {
  await goTo('The box’s own program');
  await page.getByRole('button', { name: 'Make a token' }).click();
  const secret = page.locator('.secret').first();
  await secret.waitFor();
  const token = await secret.innerText();
  assert.match(token, /^trc_/);
  const run = await page.locator('.secret').last().innerText();
  const { code } = await ask(`boxes/${box}`);
  assert.ok(run.startsWith(`trocar agent --server ${url} --box ${code} --token-file ${code}.token`), run);
  assert.ok((await page.locator('.qr path').getAttribute('d')).length > 1000, 'the code is drawn');
  await pictures('7-token');
  await goTo('Self-test');
  await page.getByText('How to do it').waitFor();
  await pictures('8-test');
  await goTo('The box’s own program');
  assert.ok(!(await page.locator('main').innerText()).includes(token), 'nobody sees it again');
  assert.equal(await state('The box’s own program'), 'done');
});

test('a step has an address of its own, and what lies on the bench outlasts a look at another page', async () => {
  await page.getByRole('link', { name: 'To the box' }).click();
  await page.getByRole('link', { name: 'Set up step by step' }).click();
  await page.goBack();
  await page.goForward();
  await goTo('Photos of the board');
  assert.equal(new URL(page.url()).searchParams.get('step'), 'photos');
  assert.equal(await page.locator('.photo.good').count(), files('boards').length);
  const focused = await page.evaluate(() => document.activeElement.id);
  assert.equal(focused, 'setup-step', 'whoever hears the page hears the step’s title');
});

test('the page asked nobody else for anything, and nothing failed on it', () => {
  assert.deepEqual(traces(), { foreign: [], broken: [] });
});
