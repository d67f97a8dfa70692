// A person sets up two instruments without tape in the set-up page: sides and sizes, pieces of the shafts painted with
// the mouse, and the picture of the empty box. REST then has both markers, and the picture stays until it is removed.
// The box's page and the session of a recording then speak of shafts, not of tape.
//
// Environment: as person.mjs, and TROCAR_BARE (a simulated scene of bare tools: clip.mp4, annotations.json, truth.json,
// empty.jpg).
import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { covered, paint, showMoment, takeFrame } from './painting.mjs';
import { requiredEnv, timeoutMs, person, url, waitUntil } from './person.mjs';

const scene = requiredEnv('TROCAR_BARE');
const marks = JSON.parse(readFileSync(join(scene, 'annotations.json'), 'utf8'));
const truth = JSON.parse(readFileSync(join(scene, 'truth.json'), 'utf8'));
const photo = join(scene, 'empty.jpg');
const WIDTHS = [1280, 390];

let browser;
let page, pageFaults, getJson, create, open, takePictures, signIn, button;
let box;

before(async () => {
  browser = await launch();
  ({ page, pageFaults, getJson, create, open, takePictures, signIn, button } = await person(browser, { prefix: 'bare-' }));
  page.setDefaultTimeout(timeoutMs);
});

after(() => browser?.close());

/** Checks that the step is not wider than a desktop screen and a phone, and that it is accessible. */
async function checkStep(name) {
  const size = page.viewportSize();
  for (const width of WIDTHS) {
    await page.setViewportSize({ width, height: 844 });
    const excess = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
    assert.ok(excess <= 0, `${name} is ${excess} px wider than ${width} px`);
  }
  await page.setViewportSize(size);
  assert.deepEqual(await violationsOf(page), []);
  await takePictures(name);
}

async function goTo(title) {
  await page.getByRole('navigation', { name: 'Set-up steps' }).getByRole('link', { name: title }).click();
  await page.locator('.setup-step h2', { hasText: title }).waitFor();
}

const tool = index => page.locator('fieldset.instrument').nth(index);
const kindOf = index => tool(index).getByLabel('Tape on the instrument');
const sideOf = index => tool(index).getByLabel('Hand');

test('an instrument without tape is described by its side and its tube, and a second one gets the other side', async () => {
  await page.goto(`${url}/boxes`);
  await signIn();
  await button('Add a box').waitFor();
  ({ id: box } = await create('boxes', { name: `Box without tape ${Date.now()}`, view: 'top' }));
  await page.goto(`${url}/boxes/${box}/setup?step=tools`);
  await page.getByText('It may have tape or not').waitFor();
  assert.equal(await page.getByText('Wind the tape').count(), 0, 'nothing is to be wound yet');
  await button('Add an instrument').click();
  await kindOf(0).selectOption('bare');
  const diameter = tool(0).getByLabel('Diameter of the tube');
  assert.equal(await diameter.inputValue(), '', 'no diameter is suggested: it has to be measured');
  await diameter.fill(String(marks.tools[0].diameter_mm));
  await tool(0).getByText('Collar and jaws').click();
  await tool(0).getByLabel('Length of the collar').fill('8');
  await tool(0).getByLabel('Length to the point of the jaws').fill('28.3');

  await button('Add an instrument').click();
  assert.equal(await kindOf(1).inputValue(), 'bare');
  assert.deepEqual([await sideOf(0).inputValue(), await sideOf(1).inputValue()], ['left', 'right']);
  await tool(1).getByLabel('Diameter of the tube').fill(String(marks.tools[1].diameter_mm));
  await sideOf(1).selectOption('left');
  await waitUntil(async () => (await sideOf(0).inputValue()) === 'right', 'the first one changes to the other side');
  await sideOf(0).selectOption('left');
  await waitUntil(async () => (await sideOf(1).inputValue()) === 'right', 'the second one changes to the other side');

  await button('Add an instrument').click();
  assert.deepEqual(await kindOf(2).locator('option').allInnerTexts(), ['Tape'], 'two bare instruments can be followed');
  await tool(2).getByRole('button', { name: 'Remove' }).click();
  await tool(2).waitFor({ state: 'detached' });
  await checkStep('tools');
});

const framesWith = label => [...new Set(marks.labels.filter(one => one.label === label).map(one => one.frame))];
const mean = values => values.reduce((sum, value) => sum + value, 0) / values.length;
/** The middle of a frame, s. */
const moment = frame => (frame + 0.5) / truth.fps;

/**
 * For each outlined shaft, the distance between its middle line and the nearest mark on a shaft of that frame, as a share
 * of the picture's width.
 */
async function outlinesApart(chosen) {
  const middle = ({ x, y, w, h }) => [x + w / 2, y + h / 2];
  const apart = [];
  for (const [index, frame] of chosen.entries()) {
    const marked = marks.labels.filter(one => one.frame === frame && one.label === 'shaft').map(middle);
    if (marked.length === 0) continue;
    const { width, shafts } = await page.locator('.frames .look').nth(index).locator('svg.shafts').evaluate(svg => ({
      width: svg.viewBox.baseVal.width,
      shafts: [...svg.querySelectorAll('g')].map(group =>
        [...group.querySelectorAll('line')].slice(0, 2).map(line => ['x1', 'y1', 'x2', 'y2'].map(name => Number(line.getAttribute(name)))),
      ),
    }));
    for (const [one, other] of shafts) {
      const [x1, y1, x2, y2] = one.map((value, i) => (value + other[i]) / 2);
      const distance = ([x, y]) => Math.abs((x2 - x1) * (y1 - y) - (x1 - x) * (y2 - y1)) / Math.hypot(x2 - x1, y2 - y1);
      apart.push(Math.min(...marked.map(distance)) / width);
    }
  }
  return apart;
}

test('strokes on shafts and on background show the shafts on every frame', async () => {
  await goTo('Colours');
  await page.getByLabel('A recording of the box').setInputFiles(join(scene, 'clip.mp4'));
  await page.waitForFunction(() => document.querySelector('.setup-step video')?.readyState >= 2);
  const chosen = [...new Set([...framesWith('shaft').slice(0, 3), ...framesWith('background').slice(0, 2)])];
  for (const frame of chosen) await takeFrame(page, moment(frame));
  await page.getByText('No piece of a shaft is marked yet').waitFor();
  await page.getByText('Mark pieces of the dark shaft, in the light and in the shade').waitFor();
  for (const [index, frame] of chosen.entries()) {
    await button(`Paint on frame ${index + 1}`).click();
    for (const one of marks.labels.filter(({ frame: own }) => own === frame)) {
      await page.locator('.choice').first().getByRole('button', { name: one.label }).click();
      await paint(page, one);
    }
  }
  await page.getByText('The shafts should be bright.').waitFor(); // only once the masks include all strokes
  const share = { shaft: [], background: [] };
  for (const [index, frame] of chosen.entries())
    for (const one of marks.labels.filter(({ frame: own }) => own === frame)) share[one.label].push(await covered(page, index, one));
  const [shaft, background] = [mean(share.shaft), mean(share.background)];
  assert.ok(shaft > 0.5 && background < shaft, `of the shafts ${shaft}, of the background ${background}`);
  const apart = await outlinesApart(chosen);
  assert.ok(apart.length > chosen.length && Math.max(...apart) < 0.1, `found and marked middles are apart by ${apart} of the picture`);
  assert.equal(await page.locator('[data-shaft]').count(), 2 * chosen.length, 'each frame says what was found of both');
  await checkStep('colours');
});

/** Learns the colours, and returns the new version as REST has it. */
async function learn(version) {
  await button('Learn the colours').click();
  await page.locator(`[data-palette="${version}"]`).waitFor();
  const [palette] = (await getJson(`boxes/${box}/palettes`)).items;
  assert.equal(palette.version, version);
  return palette;
}

test('the box then has both bare instruments, and the chosen picture of the empty box', async () => {
  await page.getByLabel('Picture of the empty box').setInputFiles(photo);
  await page.getByAltText('The chosen picture of the empty box').waitFor();
  const { annotations, verdicts } = await learn(1);
  assert.equal(annotations.empty_box, createHash('sha256').update(readFileSync(photo)).digest('hex'));
  assert.deepEqual(verdicts, []);
  const { tools, palette } = await getJson(`boxes/${box}`);
  assert.equal(palette, 1);
  assert.deepEqual(tools.map(({ name, side, diameter_mm, marker }) => ({ name, side, diameter_mm, marker })), [
    { name: 'left', side: 'left', diameter_mm: marks.tools[0].diameter_mm, marker: { kind: 'shaft', collar_mm: 8, jaw_mm: 28.3 } },
    { name: 'right', side: 'right', diameter_mm: marks.tools[1].diameter_mm, marker: { kind: 'shaft' } },
  ]);
  assert.equal(await page.getByText('The instruments were changed').count(), 0, 'the page has the stored instruments');
});

test('the picture stays when the colours are learned again, until another moment is taken or it is removed', async () => {
  const [{ annotations: first }] = (await getJson(`boxes/${box}/palettes`)).items;
  await button('Do not use this picture').click();
  await page.getByText('The box has a picture of the empty box.').waitFor();
  assert.equal((await learn(2)).annotations.empty_box, first.empty_box);

  await showMoment(page, moment(0));
  await button('Take the empty box from this clip').click();
  await page.getByAltText('The chosen picture of the empty box').waitFor();
  const { annotations: taken } = await learn(3);
  assert.match(taken.empty_box, /^[0-9a-f]{64}$/);
  assert.notEqual(taken.empty_box, first.empty_box);

  await button('Do not use this picture').click();
  await button('Remove the stored picture').click();
  await page.getByText('The stored picture will be removed').waitFor();
  await checkStep('learned');
  assert.equal((await learn(4)).annotations.empty_box, undefined);
});

test('the page of the box does not ask for tape, and its self-test uses a rod without tape', async () => {
  await open(`/boxes/${box}`);
  const card = page.locator('section.card', { has: page.getByRole('heading', { name: 'Tool colours' }) });
  const table = card.locator('table').first();
  assert.deepEqual(await table.locator('thead th').allInnerTexts(), ['Tool', 'Tape', 'Hand', 'Diameter']);
  assert.deepEqual(await table.locator('tbody td:nth-child(2)').allInnerTexts(), Array(2).fill('no tape (bare shaft)'));
  assert.equal(await page.getByText('Which tape to buy?').count(), 0);
  await page.evaluate(
    async ([at, body]) => fetch(at, { method: 'PUT', headers: { 'Content-Type': 'application/json' }, body }),
    [`/api/v1/boxes/${box}/camera`, readFileSync(join(scene, 'camera.json'), 'utf8')],
  );
  await open(`/boxes/${box}`);
  await page.getByText('Take a rod with a flat end').waitFor();
  assert.equal(await page.getByText('Wind the box’s tape').count(), 0);
});

/** The texts about a session that may speak of tape only to say that there is none, or that it would be better. */
const allowed = text => text.replaceAll(/it has no tape|with tape it is smaller|without tape/gi, '');

test('the session of a recording begins with the space that the service names, and does not speak of tape', async () => {
  const [trainee, task] = [await create('trainees', { name: 'Una Bloom' }), await create('tasks', { name: 'Pegs without tape' })];
  const id = await page.evaluate(
    async ([at, clip]) => {
      const body = Uint8Array.from(atob(clip), letter => letter.charCodeAt(0));
      return (await (await fetch(at, { method: 'POST', headers: { 'Content-Type': 'video/mp4' }, body })).json()).id;
    },
    [`/api/v1/sessions?trainee=${trainee.code}&task=${task.code}&box=${box}&filename=bare.mp4`, readFileSync(join(scene, 'clip.mp4')).toString('base64')],
  );
  await waitUntil(async () => ['done', 'failed'].includes((await getJson(`sessions/${id}`)).status), 'the score');
  const { quality, error, compare_in: compared } = await getJson(`sessions/${id}`);
  assert.notEqual(quality?.verdict ?? 'failed', 'failed', JSON.stringify(error));
  const ofTools = quality.reasons.filter(({ tool }) => tool);
  assert.ok(ofTools.length > 0 && ofTools.every(reason => reason.is_bare), JSON.stringify(ofTools));
  await open(`/sessions/${id}`);
  await page.getByText('What was seen').first().waitFor();
  if (quality.verdict !== 'refused' && compared?.space === 'image') {
    await page.getByText('Compare the values in the image: depth is poor').waitFor();
    assert.equal(await button('In the image').getAttribute('aria-pressed'), 'true');
    await button('In space').click();
    assert.equal(await button('In the image').getAttribute('aria-pressed'), 'false');
  }
  await page.locator('details summary').evaluateAll(all => all.forEach(one => (one.parentElement.open = true)));
  assert.doesNotMatch(allowed(await page.locator('main').innerText()), /tape/i);
  await takePictures('session');
  await page.evaluate(async at => fetch(at, { method: 'DELETE' }), `/api/v1/sessions/${id}`);
});

test('no page sent a request to another origin, violated the security policy or threw an error', () => {
  assert.deepEqual(pageFaults(), { foreign: [], errors: [] });
});
