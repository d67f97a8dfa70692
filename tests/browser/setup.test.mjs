// A beginner sets up a new box in the setup pages alone: board, photos (some of them bad), camera, instruments, tape
// colours painted with the mouse, the box's token. At the end the box is ready on the page and in REST.
//
// Environment: as person.mjs, and TROCAR_SETUP (a simulated scene with clip.mp4, annotations.json, boards/, and bad/
// with photos that are not usable).
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';

import { verdictOn, watchBoard } from '../../static/setup/auto_photos.js';
import { strokeRectangles } from '../../static/setup/marks.js';
import { violationsOf } from './accessibility.mjs';
import { launch, LOOKS } from './chromium.mjs';
import { covered, paint, takeFrame } from './painting.mjs';
import { requiredEnv, timeoutMs, person, url } from './person.mjs';

const scene = requiredEnv('TROCAR_SETUP');
const marks = JSON.parse(readFileSync(join(scene, 'annotations.json'), 'utf8'));
const truth = JSON.parse(readFileSync(join(scene, 'truth.json'), 'utf8'));
const NAME = `Box of a beginner ${Date.now()}`;
const A4_PX = (297 / 25.4) * 96;

let browser;
let page, pageFaults, getJson, checkLooks, signIn;
let box;

before(async () => {
  browser = await launch();
  ({ page, pageFaults, getJson, checkLooks, signIn } = await person(browser, { prefix: 'setup-' }));
  page.setDefaultTimeout(timeoutMs);
});

after(() => browser?.close());

const files = folder => readdirSync(join(scene, folder)).sort().map(name => join(scene, folder, name));

/** Checks that the current step fits the screen and is accessible in every look. */
async function checkStep(name) {
  const faults = [];
  await checkLooks(name, async look => faults.push(...(await violationsOf(page)).map(violation => `${look.name}: ${violation}`)));
  assert.deepEqual(faults, []);
}

const step = title => page.getByRole('navigation', { name: 'Set-up steps' }).getByRole('link', { name: title });
const state = async title => (await step(title).locator('.state').innerText()).trim();

async function goTo(title) {
  await step(title).click();
  await page.locator('.setup-step h2', { hasText: title }).waitFor();
}

test('the rectangles of a stroke lie under the brush and inside the picture, and do not overlap', () => {
  const size = { width: 200, height: 120 };
  const path = [[-4, 10], [60, 50], [190, 118], [230, 119]];
  const along = path.slice(1).flatMap(([x, y], i) =>
    Array.from({ length: 401 }, (_, n) => [path[i][0] + ((x - path[i][0]) * n) / 400, path[i][1] + ((y - path[i][1]) * n) / 400]));
  for (const diameter of [3, 7, 24]) {
    const painted = new Set();
    for (const { x, y, w, h } of strokeRectangles(path, diameter, size))
      for (let row = y; row < y + h; row++)
        for (let column = x; column < x + w; column++) {
          assert.ok(column >= 0 && column < size.width && row >= 0 && row < size.height);
          assert.ok(!painted.has(row * size.width + column), `${column}, ${row} is painted twice`);
          painted.add(row * size.width + column);
          const off = Math.min(...along.map(([u, v]) => Math.hypot(u - column - 0.5, v - row - 0.5)));
          assert.ok(off <= diameter / 2 + diameter / 4 + 1, `${column}, ${row} is ${off} px beside the path`);
        }
    assert.ok(painted.has(50 * size.width + 60), 'the path of the brush is painted');
  }
});

test('a new box is added, and its row links to the first step', async () => {
  await page.goto(`${url}/boxes`);
  await signIn();
  await page.getByRole('button', { name: 'Add a box' }).click();
  await page.fill('dialog input[name=name]', NAME);
  await page.getByRole('button', { name: 'Save' }).click();
  await page.getByRole('link', { name: `Set up ${NAME} step by step` }).click();
  await page.locator('.setup-step h2', { hasText: 'Print the board' }).waitFor();
  box = new URL(page.url()).pathname.split('/')[2];
  assert.equal(await state('Photos'), 'to do');
  assert.equal(await state('Colours'), 'to do');
});

test('the board is printed alone and to scale, and the measured ruler sets the size of its squares', async () => {
  await page.emulateMedia({ media: 'print' });
  await page.setViewportSize({ width: Math.ceil(A4_PX), height: 800 });
  const sheet = await page.locator('.board-sheet svg').boundingBox();
  const printedElsewhere = await page.evaluate(() => document.querySelector('.top').getClientRects().length);
  await page.emulateMedia({ media: 'screen' });
  await page.setViewportSize(LOOKS[0].viewport);
  assert.ok(Math.abs(sheet.width - A4_PX) < 0.5, `297 mm are ${sheet.width} px`);
  assert.equal(printedElsewhere, 0, 'the header is not printed');
  await page.getByLabel('Printed ruler').click();
  await page.keyboard.type('98.5'); // Key by key: the first valid length must not interrupt the input.
  assert.equal(await page.getByLabel('Side of a square').inputValue(), '20.685');
  await page.getByLabel('Printed ruler').fill('100');
  await page.getByLabel('I have measured it').check();
  assert.equal(await state('Print the board'), 'done');
  await checkStep('1-board');
});

test('the page says at once whether a photo is good, and if not, why and where', async () => {
  await goTo('Photos of the board');
  const [good, bad] = [files('boards'), files('bad')];
  await page.getByLabel('Or choose photos').setInputFiles([bad[0]]);
  const card = page.locator('.photo').first();
  await card.locator('.pill', { hasText: 'not usable' }).waitFor();
  assert.match(await card.innerText(), /Cut off at the (left|right|upper|lower)/);
  await page.getByText('The board was found in none of the photos').waitFor();
  await page.getByLabel('Or choose photos').setInputFiles([...good, ...bad.slice(1)]);
  await page.locator('.photo.good').nth(good.length - 1).waitFor();
  await page.waitForFunction(() => !document.querySelector('.photo.busy'));
  assert.equal(await page.locator('.photo.good').count(), good.length);
  assert.equal(await page.locator('.photo.good').first().locator('circle').count(), 54, 'corners are drawn');
  assert.equal(await page.locator('.photo.warn').count(), bad.length);
  const verdicts = await page.locator('.photo.warn').allInnerTexts();
  assert.ok(verdicts.some(text => text.includes('Too dark')), verdicts.join('\n'));
  await page.getByText(/Corners in \d+ of 48 parts/).waitFor();
  await checkStep('2-photos');
});

test('the page takes a photo by itself when the board is found, held still and somewhere new', async () => {
  const at = x => ({ found: true, width: 1000, corners: [[x, 10], [x + 100, 10]] });
  const nothing = { found: false, width: 1000, corners: [] };
  const taken = [at(100)];
  assert.equal(verdictOn(nothing, at(300), taken), 'search');
  assert.equal(verdictOn(at(105), at(105), taken), 'move', 'there is a photo of it');
  assert.equal(verdictOn(at(300), at(290), taken), 'still', 'it moves');
  assert.equal(verdictOn(at(300), nothing, taken), 'still', 'nothing to compare with');
  assert.equal(verdictOn(at(300), at(302), taken), 'take');
  let looks = 0;
  const [controller, verdicts] = [new AbortController(), []];
  const seen = [nothing, at(100), at(101), at(101), at(500), at(501)];
  globalThis.document = { hidden: false };
  await watchBoard({
    signal: controller.signal,
    taken: () => verdicts.filter(([verdict]) => verdict === 'take').map(([, check]) => check),
    look: async () => ({ blob: null, check: seen[looks++] }),
    onVerdict: (verdict, _, check) => (verdicts.push([verdict, check]), looks === seen.length && controller.abort()),
  });
  delete globalThis.document;
  assert.deepEqual(verdicts.map(([verdict]) => verdict), ['search', 'still', 'take', 'move', 'still', 'take']);
});

test('the camera is calibrated from the good photos, and each photo’s residual equals that of REST', async () => {
  await goTo('Calibrate');
  const good = files('boards').length;
  await page.getByRole('button', { name: `Calibrate from ${good} photos` }).click();
  await page.locator('[data-calibrated]').waitFor();
  const camera = await getJson(`boxes/${box}/camera`);
  assert.equal(camera.photos.length, good);
  assert.ok(camera.rms_px < 1, `${camera.rms_px} px`);
  const rows = page.locator('.residuals tbody tr');
  assert.equal(await rows.count(), good);
  for (const [index, photo] of camera.photos.entries()) {
    const shown = Number((await rows.nth(index).locator('td').first().innerText()).replace('−', '-'));
    assert.ok(Math.abs(shown - photo.rms_px) <= 0.05 * photo.rms_px, `${photo.file}: ${shown}, ${photo.rms_px}`);
    assert.equal(await rows.nth(index).getAttribute('data-used'), String(photo.used));
  }
  assert.ok(camera.photos.some(({ used, reason }) => !used && /bent/.test(reason)), 'bent boards are left out');
  assert.equal(await state('Calibrate'), 'done');
  await checkStep('3-calibration');
});

test('instruments are described by their tape and sizes', async () => {
  await goTo('Instruments');
  for (const [index, tool] of marks.tools.entries()) {
    await page.getByRole('button', { name: 'Add an instrument' }).click();
    const form = page.locator('fieldset.instrument').nth(index);
    await form.getByLabel('Colour of the tape').fill(tool.colour ?? tool.tool);
    if (index === 0) {
      await form.getByLabel('Diameter over the tape').fill('50');
      await form.getByText('Possible are 2 to 15 mm').waitFor();
      assert.equal(await state('Instruments'), 'check again', 'a slip of the keyboard is no size');
    }
    await form.getByLabel('Diameter over the tape').fill(String(tool.diameter_mm));
    await form.getByLabel('Length of the tape').fill(String(tool.band_length_mm));
  }
  await page.getByLabel('Camera’s view').selectOption('top');
  assert.equal(await state('Instruments'), 'done');
  await checkStep('4-tools');
});

const tapes = marks.tools.map(tool => tool.colour ?? tool.tool);
/** Frames of the clip on which this label is annotated, so that a person could paint it there. */
const framesWith = label => [...new Set(marks.labels.filter(one => one.label === label).map(one => one.frame))];

/** The moment in the middle of a frame. */
const moment = frame => (frame + 0.5) / truth.fps;

test('strokes on some frames are enough to find the tape on other frames', async () => {
  await goTo('Colours');
  await page.getByLabel('A recording of the box').setInputFiles(join(scene, 'clip.mp4'));
  await page.waitForFunction(() => document.querySelector('.setup-step video')?.readyState >= 2);
  const chosen = [...new Set(tapes.flatMap(tape => framesWith(tape).slice(0, 2)).concat(framesWith('background')[0]))];
  const unpainted = [...new Set(tapes.map(tape => framesWith(tape).at(-1)))].filter(frame => !chosen.includes(frame));
  assert.ok(unpainted.length > 0 && chosen.length + unpainted.length <= 8, 'frames to compare with');
  for (const frame of [...chosen, ...unpainted]) await takeFrame(page, moment(frame));
  await page.getByText('Paint on a tape to see it.').waitFor();
  for (const [index, frame] of chosen.entries()) {
    await page.getByRole('button', { name: `Paint on frame ${index + 1}`, exact: true }).click();
    for (const one of marks.labels.filter(({ frame: own }) => own === frame)) {
      if (!tapes.includes(one.label) && one.label !== 'background') continue;
      await page.locator('.choice').first().getByRole('button', { name: one.label === 'background' ? 'not tape' : one.label }).click();
      await paint(page, one);
    }
  }
  // The page shows this text only when the masks include all strokes.
  await page.getByText('Only the tapes should be bright.').waitFor();
  for (const [index, frame] of unpainted.entries())
    for (const one of marks.labels.filter(label => label.frame === frame)) {
      const share = await covered(page, chosen.length + index, one);
      if (tapes.includes(one.label)) assert.ok(share > 0.5, `${one.label} on frame ${frame}: ${share}`);
      if (one.label === 'background') assert.ok(share < 0.2, `background of frame ${frame}: ${share}`);
    }
  assert.ok((await page.locator('.setup-step table tbody tr').count()) >= tapes.length + 1, 'the confusion table');
  await checkStep('5-colours');
});

test('a stroke can be undone, and a point can be painted with the keyboard alone', async () => {
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

test('the colours are learned from the strokes, and the box is ready', async () => {
  await page.getByRole('button', { name: 'Learn the colours' }).click();
  await page.locator('[data-palette="1"]').waitFor();
  const { palette, calibration, tools, view } = await getJson(`boxes/${box}`);
  assert.ok(palette === 1 && calibration, 'REST says the same');
  assert.equal(view, 'top');
  assert.deepEqual(tools.map(({ diameter_mm }) => diameter_mm).sort(), marks.tools.map(tool => tool.diameter_mm).sort());
  const [{ annotations, verdicts }] = (await getJson(`boxes/${box}/palettes`)).items;
  assert.ok(annotations.labels.some(({ stroke }) => stroke > 0), 'the annotations include strokes');
  assert.deepEqual(verdicts.map(({ grade }) => grade).filter(grade => grade === 'bad'), []);
  await page.getByText('This box is ready').waitFor();
  assert.equal(await state('Colours'), 'done');
  await checkStep('6-learned');
});

test('the token of the box is shown once, with the command that uses it and a QR code', async () => {
  await goTo('Recording computer');
  await page.getByRole('button', { name: 'Make a token' }).click();
  const secret = page.locator('.secret').first();
  await secret.waitFor();
  const token = await secret.innerText();
  assert.match(token, /^trc_/);
  await page.locator('summary', { hasText: 'Or make one recording at a time' }).click();
  const [, , install, record] = await page.locator('.secret').allInnerTexts();
  const { code, calibration: { width, height } } = await getJson(`boxes/${box}`);
  const from = `--server ${url} --box ${code} --token-file ${code}.token`;
  assert.equal(install, `sudo trocar agent install ${from} --screen 8090 --option video_size=${width}x${height} /dev/video0`);
  assert.ok(record.startsWith(`trocar agent ${from} --trainee `), record);
  assert.ok((await page.locator('.qr path').getAttribute('d')).length > 1000, 'the QR code is drawn');
  await checkStep('7-token');
  await goTo('Self-test');
  await page.getByText('How to do it').waitFor();
  await checkStep('8-test');
  await goTo('Recording computer');
  assert.ok(!(await page.locator('main').innerText()).includes(token), 'the token is not shown again');
  assert.equal(await state('Recording computer'), 'done');
});

test('each step has its own address, and the photos remain after a visit to another page', async () => {
  await page.getByRole('link', { name: 'To the box' }).click();
  await page.getByRole('link', { name: 'Set up step by step' }).click();
  await page.goBack();
  await page.goForward();
  await goTo('Photos of the board');
  assert.equal(new URL(page.url()).searchParams.get('step'), 'photos');
  assert.equal(await page.locator('.photo.good').count(), files('boards').length);
  const focused = await page.evaluate(() => document.activeElement.id);
  assert.equal(focused, 'setup-step', 'the step’s title has the focus, so that a screen reader reads it');
});

test('a size is corrected without painting again', async () => {
  const paletteOf = async () => (await getJson(`boxes/${box}/palettes`)).items[0];
  const before = await paletteOf();
  await goTo('Instruments');
  const take = page.getByRole('button', { name: 'Change them' });
  if (await take.isVisible()) await take.click();
  const diameter = page.locator('fieldset.instrument').first().getByLabel('Diameter over the tape');
  const [was, is] = [await diameter.inputValue(), '5.4'];
  for (const [version, size] of [[before.version + 1, is], [before.version + 2, was]]) {
    await diameter.fill(size);
    await page.getByRole('button', { name: 'Save the sizes' }).click();
    await page.getByText('The sizes were changed').waitFor({ state: 'detached' });
    const after = await paletteOf();
    assert.equal(after.version, version);
    assert.ok(after.tools.some(tool => tool.diameter_mm === Number(size)), JSON.stringify(after.tools));
    assert.deepEqual([after.counts, after.verdicts, after.annotations.labels], [before.counts, before.verdicts, before.annotations.labels]);
  }
  assert.deepEqual((await paletteOf()).tools, before.tools);
});

test('no page sent a request to another origin, violated the security policy or threw an error', () => {
  assert.deepEqual(pageFaults(), { foreign: [], errors: [] });
});
