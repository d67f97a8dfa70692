// The review of a session in a real Chromium in front of the real service: a span is marked, the session trimmed to it, its
// tools' names swapped, the session set aside, each undone; another session is laid under it; twenty minutes open and turn without
// holding the page up. The recordings are rows that the test makes and imports, so that it knows what is in them.
//
// Environment: as person.mjs; TROCAR_BOX (a box's name); TROCAR_LONGEST_TASK_MS (how long the page may be busy without a pause, in time of the
// processor; not judged without it, but told: 50 is what a quiet machine is to keep, a busy one is slower at everything).
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { launch } from './chromium.mjs';
import { longestTasks } from './held.mjs';
import { patience, person, until, url } from './person.mjs';

const longest = Number(process.env.TROCAR_LONGEST_TASK_MS ?? Infinity);

let browser;
let page, traces, ask, picture;
let tools;
const sessions = {};

before(async () => {
  browser = await launch();
  const we = await person(browser);
  ({ page, traces, ask, picture } = we);
  await page.goto(`${url}/sessions`);
  await we.signIn();
  await we.heading('Sessions').waitFor();
});

after(() => browser?.close());

/** So many frames of two tools at 25 a second; the first moves three times as far as the second. */
function rows(frames, wild) {
  let table = 'frame,time_s,tool,x_mm,y_mm,z_mm,sigma_xy_mm,sigma_z_mm\n';
  for (let frame = 0; frame < frames; frame++)
    tools.forEach((tool, index) => {
      const time = frame / 25;
      const x = (index ? 20 : 60) * Math.sin(1.3 * time + index) + (frame === wild ? 80 : 0);
      const [y, z] = [20 * Math.cos(0.7 * time), 150 + 10 * Math.sin(0.3 * time)];
      table += `${frame},${time},${tool},${x.toFixed(3)},${y.toFixed(3)},${z.toFixed(3)},0.1,0.4\n`;
    });
  return table;
}

async function imported(name, frames, wild) {
  const [trainee, task] = [(await ask('trainees')).items[0].code, (await ask('tasks')).items[0].code];
  const boxes = (await ask('boxes')).items;
  const box = boxes.find(one => one.name === process.env.TROCAR_BOX) ?? boxes[0];
  const path = await ask(`boxes/${box.id}/palette`).then(answer => answer.items?.[0]?.tools?.map(tool => tool.name ?? tool.tool));
  tools = path?.length > 1 ? path.slice(0, 2) : (tools ?? ['orange', 'cyan']);
  const at = `/api/v1/sessions/import?trainee=${trainee}&task=${task}&box=${box.code}&tracker=Test&filename=${name}-${Date.now()}.csv`;
  const made = await page.evaluate(
    async ([address, body]) => {
      const answer = await fetch(address, { method: 'POST', headers: { 'content-type': 'text/csv' }, body });
      return { status: answer.status, body: await answer.json() };
    },
    [at, rows(frames, wild)],
  );
  // The same rows were imported by an earlier run of this test: then those.
  const id = made.status === 409 ? made.body.session.split('/').pop() : made.body.id;
  assert.ok(id, JSON.stringify(made));
  await until(async () => (await ask(`sessions/${id}`)).status === 'done', 'the import is scored');
  return id;
}

const curve = () => page.locator('.plot .u-over').first();

async function open(id) {
  await page.goto(`${url}/sessions/${id}`);
  await page.locator('.plot canvas').nth(3).waitFor({ timeout: patience });
}

/** Drags over a share of an element's width. */
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

/** Makes an edit and waits until the page shows the score made with it. */
async function edit(button, why) {
  await page.getByRole('button', { name: button }).click();
  await page.locator('dialog textarea').fill(why);
  await page.locator('dialog button[type=submit]').click();
  await page.locator('dialog').waitFor({ state: 'detached' });
  await page.locator('.edits .edit-list > li', { hasText: why }).first().waitFor();
}

const scored = id => until(async () => (await ask(`sessions/${id}/edits`)).score === 'current', 'the new score');
/** An undoing is on its way for a while, in which the score is the old one, and current. */
const undone = id => until(async () => {
  const { items, score } = await ask(`sessions/${id}/edits`);
  return score === 'current' && items.every(one => one.undone);
}, 'undone, and scored anew');
const duration = async id =>
  (await ask(`sessions/${id}`)).features.find(one => one.name === 'duration' && one.space === '3d').value;

/** The number in a feature's row of the page. */
async function shown(title) {
  const row = page.locator('.fourth tr', { has: page.locator('th', { hasText: title }) }).first();
  const cells = await row.locator('td.number').allInnerTexts();
  return cells.map(text => Number(text.split('±')[0].trim().replaceAll(',', ''))).find(value => value > 0);
}

const near = (a, b, share = 0.02) => Math.abs(a - b) <= share * Math.abs(b);

async function undoAll(id) {
  for (const one of (await ask(`sessions/${id}/edits`)).items.filter(item => !item.undone))
    await page.evaluate(at => fetch(at, { method: 'DELETE' }), `/api/v1/sessions/${id}/edits/${one.id}`);
  await undone(id);
}

test('two imports of one trainee and task are scored', async () => {
  sessions.other = await imported('other', 1400);
  sessions.own = await imported('own', 1500);
  for (const id of Object.values(sessions)) await undoAll(id);
});

test('of rows without velocities no speed is drawn, and the page says why', async () => {
  await open(sessions.own);
  await page.locator('.plot').nth(3).getByText('without velocities').waitFor();
  assert.equal(await page.getByRole('button', { name: 'By speed' }).count(), 0);
});

test('a marked span is trimmed to, the page shows what is left, and undone it is as before', async () => {
  await open(sessions.own);
  const before = await duration(sessions.own);
  assert.equal(await page.getByRole('button', { name: 'Trim', exact: true }).isDisabled(), true, 'nothing is marked yet');
  await drag(curve(), 0.25, 0.75, { shift: true });
  await picture('40-marked');
  await edit(/^Trim to/, 'Talked for the first quarter.');
  await page.locator('.notice', { hasText: 'being made' }).or(page.locator('.plot .trimmed:not([hidden])')).first().waitFor();
  await scored(sessions.own);
  const kept = await duration(sessions.own);
  assert.ok(kept < 0.6 * before, `${kept} s of ${before} s`);
  await page.waitForFunction(() => !document.querySelector('.edits .notice'));
  await until(async () => near(await shown('Time'), kept) || near(await shown('Duration'), kept), 'the page shows the new duration');
  assert.equal(await page.locator('.plot').first().locator('.trimmed:not([hidden])').count(), 2, 'both ends are shaded');
  await picture('41-trimmed');
  await page.getByRole('button', { name: /^Undo: Trimmed/ }).click();
  await undone(sessions.own);
  assert.equal(await duration(sessions.own), before);
  await page.waitForFunction(() => document.querySelectorAll('.plot .trimmed:not([hidden])').length === 0);
  await page.locator('.edits details summary').click();
  await page.locator('.edits details', { hasText: 'Talked for the first quarter.' }).waitFor();
});

test('swapped tools go by each other’s names in the curves and the read-outs', async () => {
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

test('a session that is set aside says so and counts in no progress', async () => {
  await edit('Set aside', 'Somebody else trained.');
  await page.locator('.notice.warn', { hasText: 'Somebody else trained.' }).waitFor();
  const { trainee, task } = await ask(`sessions/${sessions.own}`);
  const step = async () =>
    (await ask(`trainees/${trainee.id}/progress?task=${task.id}`)).sessions.find(one => one.id === sessions.own);
  assert.equal((await step()).set_aside, 'by_hand');
  await picture('42-set-aside');
  await page.getByRole('button', { name: 'Undo: Set aside' }).click();
  await page.locator('.notice.warn', { hasText: 'Somebody else trained.' }).waitFor({ state: 'detached' });
  assert.notEqual((await step()).set_aside, 'by_hand');
});

test('a loop plays a span again and again', async () => {
  await open(sessions.own); // Anew: what was undone just now may still be on its way into the curves.
  await drag(curve(), 0.3, 0.33, { shift: true });
  await page.getByRole('button', { name: 'Loop', exact: true }).click();
  const second = () => page.locator('.transport input[type=range]').inputValue().then(Number);
  const seen = [];
  const backwards = () => seen.filter((now, at) => at && now < seen[at - 1] - 0.5).length;
  await until(async () => (seen.push(await second()), backwards() >= 2), 'it begins again, twice');
  await page.getByRole('button', { name: 'Clear', exact: true }).click();
  await page.getByRole('button', { name: 'Pause', exact: true }).click();
  assert.ok(Math.max(...seen) - Math.min(...seen) < 3, 'within the span');
});

test('another session lies under this one from the same start, and the page says which', async () => {
  const canvas = page.locator('.space canvas');
  const ink = () => canvas.evaluate(one => one.getContext('2d').getImageData(0, 0, one.width, one.height).data.reduce((a, b) => (a * 31 + b) % 1_000_003, 7));
  const alone = await ink();
  const chooser = page.getByLabel('Compare with');
  await chooser.selectOption(sessions.other);
  await page.locator('.ghosts a').waitFor();
  assert.ok((await page.locator('.ghosts a').getAttribute('href')).endsWith(sessions.other));
  await until(async () => (await ink()) !== alone, 'its path is drawn');
  await picture('43-ghost');
  await chooser.selectOption('');
});

test('twenty minutes open, scrub, zoom and turn without holding the page up', async () => {
  sessions.long = await imported('long', 30_000, 17_003);
  let bytes = 0;
  const asked = [];
  page.on('request', one => one.url().includes('/trajectory') && asked.push(new URL(one.url()).searchParams));
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
  // What stands in the read-outs is what REST tells of that frame, once its part is here.
  const frame = Number(/frame (\d+)/.exec(await page.locator('.transport .clock').innerText())[1]);
  const path = await ask(`sessions/${sessions.long}/trajectory?from_frame=${frame}&to_frame=${frame + 1}`);
  const row = path.columns.tool.indexOf(0);
  await page.waitForFunction(
    x => document.querySelector('.readouts tbody td').textContent.replace('−', '-') === x,
    path.columns.x_mm[row].toFixed(1),
  );
  console.log(`twenty minutes: the page's longest tasks take ${tasks.slice(0, 5).join(', ')} ms of the processor`);
  assert.ok(tasks[0] > 0 && tasks[0] <= longest, `one task takes ${tasks[0]} ms`);
  assert.ok(asked[0].has('points') && !asked[0].has('from_frame'), 'first the rows that draw the same curves');
  assert.ok(asked.length > 1 && asked.slice(1).every(one => one.has('from_frame')), 'then exact ones of what is looked at');
  assert.ok(bytes > 0 && bytes < 4_000_000, `the largest path that was asked for has ${bytes} bytes`);
  await picture('44-twenty-minutes');
});

test('nothing left our origin, broke the policy or threw', () => {
  const { foreign, broken } = traces();
  assert.deepEqual(foreign, []);
  assert.deepEqual(broken.filter(line => !/\b409\b/.test(line)), []);
});
