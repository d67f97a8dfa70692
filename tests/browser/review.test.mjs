// Reviews a session in a real Chromium with the real service: marks a span, trims the session to it, swaps the names of
// the tools, sets the session aside, and undoes each edit. Overlays another session for comparison. Opens and turns a
// session of twenty minutes, and measures how long the page is blocked. The test makes and imports the recordings as
// CSV rows, so that it knows their content.
//
// Environment: as person.mjs. Optional: TROCAR_BOX (a box's name), TROCAR_LONGEST_TASK_MS (limit for one task of the
// page's main thread in ms of CPU time; without it the time is printed but not checked. A quiet machine keeps 50).
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { launch } from './chromium.mjs';
import { longestTasks } from './longest_tasks.mjs';
import { timeoutMs, person, waitUntil, url } from './person.mjs';

const maxTaskMs = Number(process.env.TROCAR_LONGEST_TASK_MS ?? Infinity);

let browser;
let page, pageFaults, getJson, takePictures;
let tools;
const sessions = {};

before(async () => {
  browser = await launch();
  const user = await person(browser);
  ({ page, pageFaults, getJson, takePictures } = user);
  await page.goto(`${url}/sessions`);
  await user.signIn();
  await user.heading('Sessions').waitFor();
});

after(() => browser?.close());

/**
 * CSV rows of two tools at 25 frames per second; the first moves three times as far. On frame `outlier` x is 80 mm off.
 */
function rows(frames, outlier) {
  let table = 'frame,time_s,tool,x_mm,y_mm,z_mm,sigma_xy_mm,sigma_z_mm\n';
  for (let frame = 0; frame < frames; frame++)
    tools.forEach((tool, index) => {
      const time = frame / 25;
      const x = (index ? 20 : 60) * Math.sin(1.3 * time + index) + (frame === outlier ? 80 : 0);
      const [y, z] = [20 * Math.cos(0.7 * time), 150 + 10 * Math.sin(0.3 * time)];
      table += `${frame},${time},${tool},${x.toFixed(3)},${y.toFixed(3)},${z.toFixed(3)},0.1,0.4\n`;
    });
  return table;
}

async function importSession(name, frames, outlier) {
  const [trainee, task] = [(await getJson('trainees')).items[0].code, (await getJson('tasks')).items[0].code];
  const boxes = (await getJson('boxes')).items;
  const box = boxes.find(one => one.name === process.env.TROCAR_BOX) ?? boxes[0];
  const path = await getJson(`boxes/${box.id}/palettes`).then(answer => answer.items?.[0]?.tools?.map(tool => tool.name ?? tool.tool));
  tools = path?.length > 1 ? path.slice(0, 2) : (tools ?? ['orange', 'cyan']);
  const at = `/api/v1/sessions/import?trainee=${trainee}&task=${task}&box=${box.code}&tracker=Test&filename=${name}-${Date.now()}.csv`;
  const made = await page.evaluate(
    async ([address, body]) => {
      const answer = await fetch(address, { method: 'POST', headers: { 'content-type': 'text/csv' }, body });
      return { status: answer.status, body: await answer.json() };
    },
    [at, rows(frames, outlier)],
  );
  // Status 409: an earlier run of this test has imported the same rows, so that session is used.
  const id = made.status === 409 ? made.body.session.split('/').pop() : made.body.id;
  assert.ok(id, JSON.stringify(made));
  await waitUntil(async () => (await getJson(`sessions/${id}`)).status === 'done', 'the import is scored');
  return id;
}

const curve = () => page.locator('.plot .u-over').first();

async function open(id) {
  await page.goto(`${url}/sessions/${id}`);
  await page.locator('.plot canvas').nth(3).waitFor({ timeout: timeoutMs });
}

/** Drags the mouse over an element, from one share of its width to another (0 to 1). */
async function drag(locator, from, to, { shift = false, steps = 40 } = {}) {
  await locator.scrollIntoViewIfNeeded();
  const box = await locator.boundingBox();
  const at = share => box.x + box.width * share;
  if (shift) await page.keyboard.down('Shift');
  await page.mouse.move(at(from), box.y + box.height / 2);
  await page.mouse.down();
  for (let step = 1; step <= steps; step++) await page.mouse.move(at(from + ((to - from) * step) / steps), box.y + box.height / 2);
  await page.mouse.up();
  if (shift) await page.keyboard.up('Shift');
}

/** Makes an edit and waits until the page lists it. */
async function edit(button, why) {
  await page.getByRole('button', { name: button }).click();
  await page.locator('dialog textarea').fill(why);
  await page.locator('dialog button[type=submit]').click();
  await page.locator('dialog').waitFor({ state: 'detached' });
  await page.locator('.edits .edit-list > li', { hasText: why }).first().waitFor();
}

const scored = id =>
  waitUntil(async () => (await getJson(`sessions/${id}/edits`)).score === 'current', 'the new score');
/**
 * Waits until all edits are undone and the score is new: before the undo is stored, the old score still counts as
 * current.
 */
const undone = id => waitUntil(async () => {
  const { items, score } = await getJson(`sessions/${id}/edits`);
  return score === 'current' && items.every(one => one.undone);
}, 'undone and scored again');
const duration = async id =>
  (await getJson(`sessions/${id}`)).features.find(one => one.name === 'duration' && one.space === '3d').value;

/** The first positive number in a feature's row on the page. */
async function shown(title) {
  const row = page.locator('.fourth tr', { has: page.locator('th', { hasText: title }) }).first();
  const cells = await row.locator('td.number').allInnerTexts();
  return cells.map(text => Number(text.split('±')[0].trim().replaceAll(',', ''))).find(value => value > 0);
}

const near = (a, b, share = 0.02) => Math.abs(a - b) <= share * Math.abs(b);

async function undoAll(id) {
  for (const one of (await getJson(`sessions/${id}/edits`)).items.filter(item => !item.undone))
    await page.evaluate(at => fetch(at, { method: 'POST' }), `/api/v1/sessions/${id}/edits/${one.id}/undo`);
  await undone(id);
}

test('two imports of one trainee and task are scored', async () => {
  sessions.other = await importSession('other', 1400);
  sessions.own = await importSession('own', 1500);
  for (const id of Object.values(sessions)) await undoAll(id);
});

test('for rows without velocities the page draws no speed, and says why', async () => {
  await open(sessions.own);
  await page.locator('.plot').nth(3).getByText('without velocities').waitFor();
  assert.equal(await page.getByRole('button', { name: 'By speed' }).count(), 0);
});

test('a session is trimmed to a marked span, the page shows the rest, and undo restores it', async () => {
  await open(sessions.own);
  const before = await duration(sessions.own);
  assert.equal(await page.getByRole('button', { name: 'Trim', exact: true }).isDisabled(), true, 'nothing is marked yet');
  await drag(curve(), 0.25, 0.75, { shift: true });
  await takePictures('40-marked');
  await edit(/^Trim to/, 'Talked for the first quarter.');
  await page.locator('.notice', { hasText: 'being recalculated' }).or(page.locator('.plot .trimmed:not([hidden])')).first().waitFor();
  await scored(sessions.own);
  const kept = await duration(sessions.own);
  assert.ok(kept < 0.6 * before, `${kept} s of ${before} s`);
  await page.waitForFunction(() => !document.querySelector('.edits .notice'));
  await waitUntil(async () => near(await shown('Time'), kept) || near(await shown('Duration'), kept), 'the page shows the new duration');
  assert.equal(await page.locator('.plot').first().locator('.trimmed:not([hidden])').count(), 2, 'both ends are shaded');
  await takePictures('41-trimmed');
  await page.getByRole('button', { name: /^Undo: Trimmed/ }).click();
  await undone(sessions.own);
  assert.equal(await duration(sessions.own), before);
  await page.waitForFunction(() => document.querySelectorAll('.plot .trimmed:not([hidden])').length === 0);
  await page.locator('.edits details summary').click();
  await page.locator('.edits details', { hasText: 'Talked for the first quarter.' }).waitFor();
});

test('after a swap the tools have each other’s names in the curves and the read-outs', async () => {
  const x = () => page.locator('.readouts tbody tr').first().locator('td').first().innerText();
  await curve().click({ position: { x: 100, y: 40 } });
  const before = await x();
  await page.locator('main').press('[');
  await drag(curve(), 0.02, 0.98, { shift: true });
  await edit(/^Swap tools in/, 'The other hands.');
  await page.waitForFunction(
    ([was]) => {
      const now = document.querySelector('.readouts tbody td').textContent;
      return now !== was && now !== '–';
    },
    [before],
  );
  await scored(sessions.own);
  await page.getByRole('button', { name: /^Undo: .* swapped/ }).click();
  await page.waitForFunction(was => document.querySelector('.readouts tbody td').textContent === was, before);
  await undone(sessions.own);
});

test('a session that is set aside shows the reason and does not count in the progress', async () => {
  await edit('Set aside', 'Another trainee used the box.');
  await page.locator('.notice.warn', { hasText: 'Another trainee used the box.' }).waitFor();
  const { trainee, task } = await getJson(`sessions/${sessions.own}`);
  const step = async () =>
    (await getJson(`trainees/${trainee.id}/progress?task=${task.id}`)).sessions.find(one => one.id === sessions.own);
  assert.equal((await step()).set_aside, 'by_hand');
  await takePictures('42-set-aside');
  await page.getByRole('button', { name: 'Undo: Set aside' }).click();
  await page.locator('.notice.warn', { hasText: 'Another trainee used the box.' }).waitFor({ state: 'detached' });
  assert.notEqual((await step()).set_aside, 'by_hand');
});

test('a loop plays a span repeatedly', async () => {
  await open(sessions.own); // Opened again, because the curves may still show the edit that was just undone.
  await drag(curve(), 0.3, 0.33, { shift: true });
  await page.getByRole('button', { name: 'Loop', exact: true }).click();
  const second = () => page.locator('.transport input[type=range]').inputValue().then(Number);
  const seen = [];
  const backwards = () => seen.filter((now, at) => at && now < seen[at - 1] - 0.5).length;
  await waitUntil(async () => (seen.push(await second()), backwards() >= 2), 'it restarts twice');
  await page.getByRole('button', { name: 'Clear', exact: true }).click();
  await page.getByRole('button', { name: 'Pause', exact: true }).click();
  assert.ok(Math.max(...seen) - Math.min(...seen) < 3, 'within the span');
});

test('another session is drawn under this one from the same start, and the page names it', async () => {
  const canvas = page.locator('.space canvas');
  const ink = () => canvas.evaluate(one => one.getContext('2d').getImageData(0, 0, one.width, one.height).data.reduce((a, b) => (a * 31 + b) % 1_000_003, 7));
  const alone = await ink();
  const chooser = page.getByLabel('Compare with');
  await chooser.selectOption(sessions.other);
  await page.locator('.ghosts a').waitFor();
  assert.ok((await page.locator('.ghosts a').getAttribute('href')).endsWith(sessions.other));
  await waitUntil(async () => (await ink()) !== alone, 'its path is drawn');
  await takePictures('43-ghost');
  await chooser.selectOption('');
});

test('a session of twenty minutes opens, scrubs, zooms and turns without blocking the page', async () => {
  sessions.long = await importSession('long', 30_000, 17_003);
  let bytes = 0;
  const requested = [];
  page.on('request', one => one.url().includes('/trajectory') && requested.push(new URL(one.url()).searchParams));
  page.on('response', async answer => {
    if (answer.url().includes('/trajectory')) bytes = Math.max(bytes, (await answer.body().catch(() => [])).length);
  });
  const tasks = await longestTasks(browser, page, async () => {
    await open(sessions.long);
    await page.waitForTimeout(1500);
    await drag(curve(), 0.05, 0.95);
    await drag(page.locator('.space canvas'), 0.2, 0.8);
    await page.getByLabel('Show', { exact: true }).selectOption('20');
    await page.locator('main').press('.');
    await page.waitForTimeout(1500);
  });
  // The read-outs show the values of REST for this frame, as soon as the page has loaded the exact rows around it.
  const frame = Number(/frame (\d+)/.exec(await page.locator('.transport .clock').innerText())[1]);
  const path = await getJson(`sessions/${sessions.long}/trajectory?from_frame=${frame}&to_frame=${frame + 1}`);
  const row = path.columns.tool.indexOf(0);
  await page.waitForFunction(
    x => document.querySelector('.readouts tbody td').textContent.replace('−', '-') === x,
    path.columns.x_mm[row].toFixed(1),
  );
  console.log(`twenty minutes: the page's longest tasks take ${tasks.slice(0, 5).join(', ')} ms of CPU time`);
  assert.ok(tasks[0] > 0 && tasks[0] <= maxTaskMs, `one task takes ${tasks[0]} ms`);
  assert.ok(requested[0].has('points') && !requested[0].has('from_frame'), 'first the reduced rows, which draw the same curves');
  assert.ok(requested.length > 1 && requested.slice(1).every(one => one.has('from_frame')), 'then the exact rows of the visible range');
  assert.ok(bytes > 0 && bytes < 4_000_000, `the largest requested path has ${bytes} bytes`);
  await takePictures('44-twenty-minutes');
});

test('no page sent a request to another origin, violated the security policy or threw an error', () => {
  const { foreign, errors } = pageFaults();
  assert.deepEqual(foreign, []);
  assert.deepEqual(errors.filter(line => !/\b409\b/.test(line)), []);
});
