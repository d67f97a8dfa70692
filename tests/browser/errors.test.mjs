// Sets error items and a formula from an example, counts errors of an imported session with buttons and keys, finishes the sheet
// and reads the score, in a real Chromium with the real service.
//
// Environment: as person.mjs. Optional: TROCAR_BOX, TROCAR_TRAINEE (names).
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { create, person, url, waitUntil } from './person.mjs';

let browser;
let page, pageFaults, getJson, takePictures;
let task, id;

const named = async (list, name) => (await getJson(list)).items.find(one => one.name === name) ?? (await getJson(list)).items[0];
const button = name => page.getByRole('button', { name, exact: true });
const sheets = () => getJson(`sessions/${id}/error-sheets`);

before(async () => {
  browser = await launch();
  const user = await person(browser);
  ({ page, pageFaults, getJson, takePictures } = user);
  await page.goto(`${url}/sessions`);
  await user.signIn();
  await user.heading('Sessions').waitFor();
});

after(() => browser?.close());

/** The cells of a line of a CSV table, without line breaks in them. */
const cellsOf = line => [...line.matchAll(/(?:^|[,;])(?:"((?:[^"]|"")*)"|([^,;]*))/g)].map(([, quoted, plain]) => quoted?.replaceAll('""', '"') ?? plain);

/** Imports a path of a tool. */
async function importSession(frames = 250) {
  const [trainee, box] = [await named('trainees', process.env.TROCAR_TRAINEE), await named('boxes', process.env.TROCAR_BOX)];
  const rows = ['frame,time_s,tool,x_mm,y_mm,z_mm'];
  for (let frame = 0; frame < frames; frame++) {
    const time = frame * 0.04;
    rows.push(`${frame},${time.toFixed(2)},${box.tools[0].name},${40 * Math.sin(time * 1.3)},${20 * Math.cos(time * 0.7)},150`);
  }
  const at = `/api/v1/sessions/import?trainee=${trainee.code}&task=${task.code}&box=${box.code}`;
  return page.evaluate(async ([address, body]) => {
    const made = await fetch(address, { method: 'POST', headers: { 'Content-Type': 'text/csv' }, body });
    if (!made.ok) throw new Error(`${made.status} ${await made.text()}`);
    return (await made.json()).id;
  }, [at, rows.join('\n')]);
}

test('items and formula of a task begin with an example, and the formula is tried before it is set', async () => {
  task = await create(page, 'tasks', { name: 'Loop of the error test' });
  id = await importSession();
  await waitUntil(async () => (await getJson(`sessions/${id}`)).status === 'done', 'the score');
  await page.goto(`${url}/tasks/${task.code}`);
  await button('Set error items').click();
  await page.getByLabel('Start from an example').selectOption('loop');
  await page.getByText('not official').first().waitFor();
  await takePictures('error-items');
  await button('Set these error items').click();
  await page.getByText('This formula belongs to the example').waitFor();
  await button('Calculate').click();
  await page.getByText('no error sheet is finished').waitFor();
  await takePictures('error-formula');
  await button('Set this formula').click();
  await page.getByText('Version 1 of the formula is set.').waitFor();
  await page.getByText('180 − Measured duration').waitFor();
  await takePictures('errors-of-task');
  assert.deepEqual(await violationsOf(page), []);
});

test('errors are counted by button and key, undone, typed, and finished', async () => {
  await page.goto(`${url}/sessions/${id}?t=4`);
  await button('Count errors').click();
  const slips = page.getByRole('button', { name: /^Knot slips/ });
  await slips.click();
  assert.equal(await slips.getAttribute('aria-pressed'), 'true');
  await page.keyboard.press('3');
  await waitUntil(async () => (await sheets()).open.marks.length === 2, 'the marks');
  await button('Undo the last one').click();
  await waitUntil(async () => (await sheets()).open.marks.length === 1, 'the undone mark');
  await page.getByText('Not typed: Distance of the loop from the mark.').waitFor();
  await page.getByLabel('Distance of the loop from the mark').fill('2');
  await page.keyboard.press('Tab');
  await takePictures('error-sheet');
  await button('Finish with 1 error').click();
  await page.getByText('Your sheet is finished and counts.').waitFor();
  const { score: { score }, items: [sheet] } = await sheets();
  assert.ok(Math.abs(score.points - (180 - score.time_s - 2 * 10 - 25)) < 1e-9, JSON.stringify(score));
  assert.ok(sheet.marks[0].at_s >= 0, 'the tap has its time in the recording');
  const row = page.getByRole('row', { name: /^Error score/ });
  assert.match(await row.innerText(), new RegExp(score.value.toFixed(1)));
  await page.getByText('Where they were seen').click();
  await page.getByRole('button', { name: /^Go to/ }).last().click();
  await takePictures('error-score');
  assert.deepEqual(await violationsOf(page), []);
});

test('a sheet without marks says that no error was seen', async () => {
  await button('Correct my sheet').click();
  await page.getByRole('button', { name: /^Knot slips/ }).click();
  await button('Finish: no errors seen').click();
  await waitUntil(async () => (await sheets()).items[0]?.marks.length === 0, 'the corrected sheet');
  const { score: { score } } = await sheets();
  assert.ok(Math.abs(score.points - (180 - score.time_s - 2 * 10)) < 1e-9, JSON.stringify(score));
});

test('progress shows the score, a session without a sheet as a gap, and both in the table', async () => {
  const unrated = await importSession(300);
  await waitUntil(async () => (await getJson(`sessions/${unrated}`)).status === 'done', 'the score of the second session');
  const { score: { score } } = await sheets();
  const { trainee } = await getJson(`sessions/${id}`);
  await page.goto(`${url}/trainees/${trainee.id}?task=${task.id}`);
  const card = page.locator('.error-scores');
  await card.getByText('1 session: Not rated').waitFor();
  await card.getByText('Formula version 1.').waitFor();
  assert.match(await card.locator('.dot title').textContent(), new RegExp(score.value.toFixed(1)));
  assert.equal(await card.locator(`a[href$="/sessions/${unrated}"] .gap`).count(), 1);
  await card.scrollIntoViewIfNeeded();
  await takePictures('error-progress');
  const saved = page.waitForEvent('download');
  await button('Save as table (CSV)').click();
  const chunks = [];
  for await (const chunk of await (await saved).createReadStream()) chunks.push(chunk);
  const [headings, rated, gap] = Buffer.concat(chunks).toString().trim().split(/\r?\n/).map(cellsOf);
  const [ofScore, ofVersion] = ['Error score', 'Error score: version of the formula'].map(name => headings.indexOf(name));
  assert.ok(ofScore > 0 && ofVersion > 0, headings.join(' | '));
  assert.deepEqual([rated[ofVersion], gap[ofVersion], gap[ofScore]], ['1', '1', '']);
  assert.equal(Number(rated[ofScore].replace(',', '.')).toFixed(1), score.value.toFixed(1));
  assert.match(gap.at(-1), /^Not rated: no error sheet is finished/);
  assert.deepEqual(await violationsOf(page), []);
  assert.deepEqual(pageFaults(), { foreign: [], errors: [] });
});
