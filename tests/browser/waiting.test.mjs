// Recordings that wait for a name, in a real Chromium: three come from a box, staff look at one, name two at once and discard
// the third. Everything is done with the keyboard where a person may have only one.
//
// Environment: as person.mjs, and TROCAR_CLIP, a recording of the box.
import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { person, url, waitUntil } from './person.mjs';

const mark = Date.now().toString(36); // So that the scenario can run again in the same centre.
const NAME = `Una Named ${mark}`;
const made = {};

let browser;
let admin;

before(async () => {
  browser = await launch();
  admin = await person(browser, { prefix: 'waiting-' });
});

after(() => browser?.close());

/** The clip with other bytes: players skip the box that is appended. */
async function send(filename, salt) {
  const clip = await readFile(process.env.TROCAR_CLIP);
  const tail = Buffer.from(`\0\0\0\x20free${mark.padEnd(12)}${String(salt).padEnd(12)}`, 'latin1');
  const token = made.token.token;
  const query = new URLSearchParams({ filename, recorded_at: '2026-03-11T09:30:00Z' });
  const answer = await fetch(`${url}/api/v1/waiting-recordings?${query}`, {
    method: 'POST',
    headers: { authorization: `Bearer ${token}`, 'content-type': 'video/mp4' },
    body: Buffer.concat([clip, tail]),
  });
  assert.equal(answer.status, 201, await answer.text());
}

test('recordings without a name are counted in the navigation', async () => {
  await admin.page.goto(url);
  await admin.signIn();
  await admin.page.locator('header.top nav').waitFor();
  made.box = await admin.create('boxes', { name: `Unnamed table ${mark}` });
  made.task = await admin.create('tasks', { name: `Unnamed pegs ${mark}` });
  made.trainee = await admin.create('trainees', { name: NAME });
  made.token = await admin.create('tokens', { name: 'beside the table', role: 'agent', box: made.box.id });
  await send(`una_named_${mark}.mp4`, 1);
  await send('07.mp4', 2);
  await send('08.mp4', 3);
  await admin.page.goto(url);
  await admin.page.locator('header.top nav a[href$="/waiting"] .count').waitFor();
  await admin.open('/waiting');
  await admin.page.getByRole('heading', { name: new RegExp(`Unnamed table ${mark}`) }).waitFor();
  await waitUntil(async () => (await admin.page.locator('.waiting img').evaluateAll(all => all.filter(one => one.naturalWidth > 0).length)) >= 3);
  assert.equal(await admin.page.getByLabel(`Trainee of una_named_${mark}.mp4`).inputValue(), made.trainee.id, 'proposed from the name');
  assert.deepEqual(await violationsOf(admin.page), []);
  await admin.takePictures('list');
});

test('one is played, two are assigned at once, and the third is discarded', async () => {
  await admin.button('Play 07.mp4').click();
  await waitUntil(async () => (await admin.page.locator('dialog video').evaluate(video => video.readyState)) >= 1);
  await admin.takePictures('play');
  await admin.page.keyboard.press('Escape');
  for (const name of [`una_named_${mark}.mp4`, '07.mp4']) {
    await admin.page.getByLabel(`Choose ${name}`).focus();
    await admin.page.keyboard.press('Space');
  }
  const all = admin.page.locator('.waiting-actions');
  await all.getByLabel('Trainee').selectOption(made.trainee.id);
  await all.getByLabel('Task').selectOption(made.task.id);
  await admin.takePictures('chosen');
  await admin.button('Assign 2').click();
  await admin.page.getByText('2 recordings have a name now').first().waitFor();
  await admin.takePictures('assigned');
  const sessions = await admin.page.evaluate(async at => (await (await fetch(at)).json()).items, `/api/v1/sessions?trainee=${made.trainee.id}`);
  assert.deepEqual(sessions.map(one => one.filename).sort(), ['07.mp4', `una_named_${mark}.mp4`].sort());
  assert.ok(sessions.every(one => one.recorded_at === '2026-03-11T09:30:00Z' && one.supervision === 'none'));
  await admin.open('/');
  await admin.page.locator('main a[href$="/waiting"]').click();
  await admin.page.getByLabel('Choose 08.mp4').check();
  await admin.button('Discard 1 …').click();
  await admin.page.locator('dialog').getByRole('button', { name: 'Discard 1 …' }).click();
  await admin.page.getByLabel('Choose 08.mp4').waitFor({ state: 'detached' });
});
