// Uploads a recording of another box under box 1 in a real Chromium with the real service. The page asks whether it is the
// box, lists say so, and each answer has its effect. Undoing the answer asks again. Then the session is moved.
//
// Environment: as person.mjs, and TROCAR_OTHER_BOX (a recording of another box with the same tapes). Optional: TROCAR_BOX,
// TROCAR_TRAINEE, TROCAR_TASK (names).
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { after, before, test } from 'node:test';

import { launch } from './chromium.mjs';
import { person, requiredEnv, waitUntil, url } from './person.mjs';

const clip = readFileSync(requiredEnv('TROCAR_OTHER_BOX')).toString('base64');
const named = async (list, name) => (await getJson(list)).items.find(one => one.name === name) ?? (await getJson(list)).items[0];

let browser;
let page, pageFaults, getJson, takePictures;
let id, box;

before(async () => {
  browser = await launch();
  const user = await person(browser);
  ({ page, pageFaults, getJson, takePictures } = user);
  await page.goto(`${url}/sessions`);
  await user.signIn();
  await user.heading('Sessions').waitFor();
});

after(() => browser?.close());

const session = () => getJson(`sessions/${id}`);
const question = () => page.locator('.notice', { hasText: `Is this ${box.name}?` });
const isScored = async () => (await getJson(`sessions/${id}/edits`)).score === 'current';

async function answer(button, remark) {
  await page.getByRole('button', { name: button, exact: true }).click();
  const dialog = page.locator('dialog[open]');
  if (remark) await dialog.locator('textarea').fill(remark);
  await dialog.getByRole('button', { name: button.startsWith('Yes') ? 'Yes, it is this box' : button }).click();
  await dialog.waitFor({ state: 'detached' });
  await waitUntil(isScored, 'the new score');
}

test('a recording of another box is asked about, on its page and in the lists', async () => {
  box = await named('boxes', process.env.TROCAR_BOX);
  const trainee = await named('trainees', process.env.TROCAR_TRAINEE);
  const task = await named('tasks', process.env.TROCAR_TASK);
  const at = `/api/v1/sessions?trainee=${trainee.code}&task=${task.code}&box=${box.code}&filename=other-box.mp4`;
  id = await page.evaluate(
    async ([address, content]) => {
      const body = Uint8Array.from(atob(content), letter => letter.charCodeAt(0));
      const made = await fetch(address, { method: 'POST', headers: { 'Content-Type': 'video/mp4' }, body });
      if (!made.ok) throw new Error(`${made.status} ${await made.text()}`);
      return (await made.json()).id;
    },
    [at, clip],
  );
  await waitUntil(async () => (await session()).status === 'done', 'the score');
  await page.goto(`${url}/sessions/${id}`);
  await question().waitFor();
  assert.match(await question().innerText(), /counts nowhere/);
  assert.match(await question().innerText(), /lengths and speeds may be wrong/);
  await page.locator('.verdict', { hasText: 'does not look like the box' }).waitFor();
  await takePictures('46-box-question');
  await page.goto(`${url}/sessions`);
  await page.locator('tr', { has: page.locator(`a[href$="${id}"]`) }).getByText('Is it this box?').waitFor();
  await page.goto(`${url}/`);
  const listed = page.locator('.queue li', { has: page.locator(`a[href$="${id}"]`) }); // also among the latest sessions
  await listed.getByText('Is it this box?').first().waitFor();
});

test('an entry of what needs attention is put off for a week, and undone', async () => {
  const card = page.locator('.card', { has: page.getByRole('heading', { name: 'Needs attention' }) });
  const entry = card.locator('.queue > li', { has: page.locator(`a[href$="${id}"]`) });
  assert.equal(await entry.getByRole('button', { name: /^Dismiss/ }).count(), 0, 'it counts nowhere until it is answered');
  await entry.getByRole('button', { name: /^Show again in a week/ }).click();
  await entry.waitFor({ state: 'detached' });
  await card.getByText('1 entry that you removed').waitFor();
  await card.getByRole('status').getByRole('button', { name: 'Undo' }).click();
  await entry.waitFor();
});

test('a recording that is older than the set-up of its box says so, until the version is dated back', async () => {
  const { recorded_at: recorded, setup } = await session();
  assert.deepEqual([setup.calibration.is_later, setup.palette.is_later], [false, false]);
  const [calibration] = (await getJson(`boxes/${box.id}/calibrations`)).items;
  const later = new Date(Date.parse(recorded) + 1).toISOString();
  const status = await page.evaluate(async ([address, valid_from]) => {
    const headers = { 'Content-Type': 'application/json' };
    return (await fetch(address, { method: 'PATCH', headers, body: JSON.stringify({ valid_from }) })).status;
  }, [`/api/v1/boxes/${box.id}/calibrations/${calibration.id}`, later]);
  assert.equal(status, 200);
  // The service allows a day between a recording and the set-up, and no version is valid from the future on.
  const address = `**/api/v1/sessions/${id}`;
  await page.route(address, async route => {
    const response = await route.fetch();
    const json = await response.json();
    json.setup.calibration.is_later = Date.parse(json.setup.calibration.valid_from) > Date.parse(json.recorded_at);
    await route.fulfill({ response, json });
  });
  await page.goto(`${url}/sessions/${id}`);
  const warning = page.locator('.notice', { hasText: 'older than the set-up of its box' });
  await warning.waitFor();
  await takePictures('47-older-than-set-up');
  await warning.getByRole('link', { name: `Camera and tool colours of ${box.name}` }).click();
  await page.locator('summary', { hasText: 'All calibrations' }).click();
  await page.getByText('valid since').first().waitFor();
  await page.getByRole('button', { name: `Change the date: Version ${calibration.version}` }).click();
  const dialog = page.locator('dialog[open]');
  await takePictures('48-valid-since');
  await dialog.getByLabel('Valid since').fill('');
  await dialog.getByRole('button', { name: 'Save' }).click();
  await dialog.waitFor({ state: 'detached' });
  await takePictures('49-box-versions');
  await page.goto(`${url}/sessions/${id}`);
  await page.locator('.verdict').first().waitFor();
  assert.equal(await warning.count(), 0);
  await page.unroute(address);
  assert.equal((await session()).setup.calibration.is_later, false);
});

test('no: its values are withheld, and the page says what to do', async () => {
  await page.goto(`${url}/sessions/${id}`);
  await answer('No, it is another box', 'It was box 3.');
  await page.locator('.notice', { hasText: `This recording is not from ${box.name}` }).waitFor();
  assert.equal(await question().count(), 0);
  assert.ok((await session()).features.every(feature => feature.value === null));
  const entry = page.locator('.edits .edit-list > li', { hasText: 'Recorded in another box' });
  assert.match(await entry.first().innerText(), /It was recorded in another box\. It was box 3\./);
  const notice = page.locator('.notice', { hasText: 'Move it to the box where it was recorded' });
  await notice.getByRole('button', { name: 'Move', exact: true }).click();
  const dialog = page.locator('dialog[open]');
  assert.equal(await dialog.getByLabel('Box').locator('option:checked').innerText(), box.name);
  await dialog.getByRole('button', { name: 'Cancel' }).click();
  await takePictures('47-other-box');
});

test('undone, it is asked again; yes: it counts and nothing is asked', async () => {
  await page.getByRole('button', { name: 'Undo: Recorded in another box' }).click();
  await waitUntil(isScored, 'the score before the answer');
  await question().waitFor();
  await answer(`Yes, it is ${box.name}`);
  await waitUntil(async () => (await question().count()) === 0, 'no question');
  await page.locator('.edits .edit-list > li', { hasText: 'Recorded in this box' }).first().waitFor();
  const now = await session();
  assert.equal(now.box_question, 'this_box');
  assert.ok(now.features.some(feature => feature.value !== null));
  assert.ok(!now.quality.reasons.some(reason => reason.name.startsWith('box_')), 'its lengths are promised again');
});

test('the session is moved to another task with a reason, and back', async () => {
  const before = await session();
  const other = await page.evaluate(async () => {
    const body = JSON.stringify({ name: 'Threading in a box' });
    const made = await fetch('/api/v1/tasks', { method: 'POST', headers: { 'Content-Type': 'application/json' }, body });
    return made.json();
  });
  const moveTo = async (task, why) => {
    await page.locator('.head').getByRole('button', { name: 'Move', exact: true }).click();
    const dialog = page.locator('dialog[open]');
    await dialog.getByLabel('Task').selectOption({ label: task });
    await dialog.getByLabel('Why?').fill(why);
    await dialog.getByRole('button', { name: 'Move', exact: true }).click();
    await dialog.waitFor({ state: 'detached' });
    await page.getByRole('heading', { level: 1 }).getByText(task).waitFor();
  };
  await moveTo(other.name, 'The wrong task was chosen.');
  await page.getByText('This session was moved once').click();
  const entry = page.locator('.moves li').first();
  assert.match(await entry.innerText(), /Task: .+ → Threading in a box\s+The wrong task was chosen\./);
  const moved = await session();
  assert.deepEqual([moved.task.id, moved.result], [other.id, before.result]);
  await takePictures('48-moved');
  await moveTo(before.task.name, 'It was the right one.');
  assert.deepEqual((await session()).features, before.features);
});

test('no page sent a request to another origin, violated the security policy or threw an error', () => {
  const { foreign, errors } = pageFaults();
  assert.deepEqual([foreign, errors], [[], []]);
});
