// Uses the service in a real Chromium as a person would: sign in, upload a recording, wait for its score without
// reloading, play the overlay, watch a box that sends live. One scenario in steps; each step needs the steps before it.
//
// Environment: as person.mjs, and TROCAR_CLIP (a recording that TROCAR_BOX can score); optional TROCAR_BOX,
// TROCAR_TRAINEE, TROCAR_TASK (names; otherwise the first of each), TROCAR_SELF_TEST (a recording of that box's
// self-test with a board of 9x6 corners and 21 mm).
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, statSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { basename, join } from 'node:path';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { HOSTILE, injectedElements } from './hostile.mjs';
import { requiredEnv, pagesOf, password, timeoutMs, person, url } from './person.mjs';
import { beginFeed, endFeed } from './sender.mjs';

const clip = requiredEnv('TROCAR_CLIP');
const selfTest = process.env.TROCAR_SELF_TEST;

let browser;
let page, pageFaults, getJson, create, checkLooks, takePictures, printToPdf, heading, signIn, open;
let session;

before(async () => {
  browser = await launch();
  const user = await person(browser);
  ({ page, pageFaults, getJson, create, checkLooks, takePictures, printToPdf, heading, signIn, open } = user);
});

after(() => browser?.close());

test('a wrong password shows an error message, the right one opens the requested page', async () => {
  await page.goto(`${url}/upload`);
  await signIn(`${password}, but wrong`);
  await page.locator('[role=alert]').waitFor();
  await takePictures('01-sign-in-refused');
  await signIn();
  await heading('Upload').waitFor();
});

test('a recording is uploaded, and the page links to its session', async () => {
  for (const [label, wanted] of [
    ['Trainee', process.env.TROCAR_TRAINEE],
    ['Task', process.env.TROCAR_TASK],
    ['Box', process.env.TROCAR_BOX],
  ]) {
    const chooser = page.getByLabel(label, { exact: true });
    if (wanted) await chooser.selectOption({ label: wanted });
    else if (!(await chooser.inputValue())) await chooser.selectOption({ index: 1 });
  }
  await page.setInputFiles('.drop input[type=file]', clip);
  const entry = page.locator('.sending li', { hasText: basename(clip) }).first();
  const open = entry.getByRole('link', { name: 'Open the session' });
  await open.waitFor({ timeout: timeoutMs });
  await takePictures('02-uploaded');
  await open.click();
  await page.waitForURL('**/sessions/*');
  session = new URL(page.url()).pathname.split('/').pop();
  const uploaded = await getJson(`sessions/${session}`);
  assert.equal(uploaded.filename, basename(clip));
  assert.equal(uploaded.video.bytes, statSync(clip).size, 'every byte arrived');
});

test('the score appears without a reload', async () => {
  await page.evaluate(() => (window.notReloaded = true));
  const ended = page.locator('.plots canvas').first().or(page.locator('main .notice.bad'));
  await ended.first().waitFor({ timeout: timeoutMs });
  assert.equal(await page.locator('main .notice.bad').count(), 0, await page.locator('main').innerText());
  assert.equal(await page.evaluate(() => window.notReloaded), true);
  await page.waitForFunction(() => document.querySelector('video')?.readyState >= 2);
  await takePictures('03-session');
});

test('sessions are searched, filtered and counted, and the address of the list keeps the filter', async () => {
  const list = async query => (await getJson(`session-count${query}`)).matching;
  await page.goto(`${url}/sessions`);
  const rows = page.locator('main tbody tr');
  await rows.first().waitFor();
  const { trainee, filename, recorded_at } = await getJson(`sessions/${session}`);
  const count = page.locator('.listed');
  await page.getByLabel('Search').fill(`${trainee.name} ${filename}`.toUpperCase());
  await page.waitForURL('**/sessions?search=*');
  await page.waitForFunction(text => document.querySelector('main tbody')?.innerText.includes(text), filename);
  const found = await list(`?search=${encodeURIComponent(`${trainee.name} ${filename}`)}`);
  assert.ok(found > 0);
  await count.filter({ hasText: new RegExp(`^${found} session`) }).waitFor(); // The count comes after the rows.
  const outcome = page.getByLabel('Outcome');
  await outcome.selectOption('quarantined');
  await page.getByText('No session matches these filters').waitFor();
  assert.match(await count.innerText(), /^0 sessions\. The filters hide \d+ others?\.$/);
  const address = page.url();
  await page.goto(`${url}/tasks`);
  await page.goBack();
  await page.getByText('No session matches these filters').waitFor();
  assert.equal(page.url(), address, 'back keeps the filter');
  await page.getByRole('button', { name: 'Clear the filters' }).first().click();
  await rows.first().waitFor();
  assert.equal(await page.getByLabel('Search').inputValue(), '');
  const day = new Date(recorded_at).toLocaleDateString('sv');
  await page.goto(`${url}/sessions?from=${day}&to=${day}&order=arrival`);
  await page.waitForFunction(text => document.querySelector('main tbody')?.innerText.includes(text), filename);
  await takePictures('03-sessions');
  await page.goto(`${url}/sessions/${session}`);
  await page.getByText('Supervised: recorded or sent by').waitFor();
  await page.waitForFunction(() => document.querySelector('video')?.readyState >= 2);
});

test('the page shows the same value and error of a feature as REST', async () => {
  await page.getByRole('button', { name: 'In space', exact: true }).click();
  const { features, tools } = await getJson(`sessions/${session}`);
  const first = features.find(feature => feature.space === '3d' && feature.tool === tools[0] && feature.value !== null);
  const row = page.locator('.fourth tr', { has: page.locator('th', { hasText: first.title }) }).first();
  const [shown, off] = (await row.locator('td').first().innerText())
    .split('±')
    .map(text => Number(text.trim().replace('−', '-').replaceAll(',', '')));
  const half = (first.error.high - first.error.low) / 2;
  for (const [what, page, rest] of [['value', shown, first.value], ['error', off, half]])
    assert.ok(Math.abs(page - rest) <= 0.05 * Math.abs(rest), `${what} of ${first.name}: page ${page}, REST ${rest}`);
});

test('where depth is poor, the values in the image come first, and what needs depth says how far off it is', async () => {
  const address = `**/api/v1/sessions/${session}`;
  const image = (await getJson(`sessions/${session}`)).features.find(one => one.name === 'path_length' && one.space === 'image' && one.value !== null);
  await page.route(address, async route => {
    const answer = await route.fetch();
    const data = await answer.json();
    data.compare_in = { space: 'image', path_error_3d: 0.52, path_error_image: 0.12 };
    const volume = data.features.find(one => one.name === 'working_volume' && one.tool === image.tool);
    Object.assign(volume, { value: 100, not_enough: null, error: { sigma: 30, low: 40, high: 160, as_measured: 100 }, no_error: null });
    await route.fulfill({ response: answer, json: data });
  });
  await page.reload();
  const notice = page.locator('.notice', { hasText: 'Compare the values in the image' });
  await notice.waitFor();
  assert.match(await notice.innerText(), /off by 52%, lengths in the image by 12%/);
  assert.equal(await page.getByRole('button', { name: 'In the image', exact: true }).getAttribute('aria-pressed'), 'true');
  await page.getByRole('button', { name: 'Show all features' }).click();
  const groups = page.locator('.fourth .fold');
  const column = (await page.locator('.fourth thead').first().locator('th').allInnerTexts()).findIndex(head => head.includes(image.tool));
  const shown = title => groups.locator('tr', { has: page.locator('th', { hasText: title }) }).first().locator('td').nth(column - 1).innerText();
  const [length] = (await shown('Path length')).split('±').map(text => Number(text.trim().replaceAll(',', '')));
  assert.ok(Math.abs(length - image.value) <= 0.05 * image.value, `page ${length}, REST ${image.value} in the image`);
  const deep = groups.filter({ hasText: 'In space: these values need depth' });
  assert.equal(await deep.count(), 1);
  assert.equal(await groups.last().innerText(), await deep.innerText(), 'they follow at the end');
  assert.match(await shown('Working volume'), /± 60\s*too uncertain to compare/);
  await page.getByRole('button', { name: 'Fold the families' }).click();
  await page.unroute(address);
  await page.reload();
  await page.locator('.plots canvas').first().waitFor();
});

test('the most used measures come first, and each family is a fold that stays as it was left and is printed', async () => {
  const address = `**/api/v1/sessions/${session}`;
  const { features } = await getJson(`sessions/${session}`);
  const uncertain = features.find(one => one.name === 'mean_velocity' && one.space === '3d' && one.value !== null);
  await page.route(address, async route => {
    const answer = await route.fetch();
    const data = await answer.json();
    for (const one of data.features) Object.assign(one, { informative: true, too_uncertain: null });
    const same = one => one.name === uncertain.name && one.space === '3d';
    for (const one of data.features.filter(same)) Object.assign(one, { informative: false, too_uncertain: 'as_large_as_value' });
    const duration = data.features.find(one => one.name === 'duration' && one.tool === null);
    Object.assign(duration, { value: 8.2, not_enough: null, no_error: null, is_lower_bound: false, error: { sigma: 0.54, low: 7.1, high: 9.3, as_measured: 8.2 },
      target: { limit: 9, better: 'lower', standard: 1 }, judgement: 'undecided' });
    await route.fulfill({ response: answer, json: data });
  });
  await page.reload();
  await page.getByRole('button', { name: 'In space', exact: true }).click();
  const fold = title => page.locator('.fold', { has: page.locator('summary', { hasText: title }) });
  const openFolds = () => page.locator('.fold[open] > summary > span').allInnerTexts();
  const titles = part => part.locator('tbody th[scope=row]').evaluateAll(cells => cells.map(cell => cell.textContent.trim()));
  assert.deepEqual(await openFolds(), ['The standard and the most used measures']);
  assert.deepEqual(await titles(fold('The standard')), ['Duration', 'Path length', 'Depth travelled', 'Log dimensionless jerk', 'Idle share']);
  const undecided = '8.2 ± 1.1 s against at most 9 s: the error bar reaches past the limit, so it counts neither as kept nor as missed; with the same error, at most 7.9 s would be kept.';
  for (const place of ['.fourth', '.outcome-card']) assert.equal(await page.locator(place).getByText(undecided).count(), 1, place);
  await page.locator('.fourth .meaning', { hasText: 'How long the attempt took' }).getByText('Lower is better.').waitFor();
  await page.locator('.how summary').first().click();
  await page.locator('.how').first().getByText('Time from the moment that the first tool starts to move').waitFor();

  await fold('Speed').locator('summary').first().press('Enter');
  const speed = await titles(fold('Speed'));
  assert.equal(speed.at(-1), uncertain.title, 'what says nothing follows the others of its family');
  const row = fold('Speed').locator('tr', { has: page.locator('th', { hasText: uncertain.title }) });
  await row.locator('td.faint', { hasText: 'too uncertain' }).first().waitFor();
  assert.match(await fold('Speed').locator('.note').first().innerText(), /too uncertain to say something: the error is as large as the value\.$/i);
  assert.deepEqual(await violationsOf(page), []);

  await page.reload();
  await fold('Speed').waitFor();
  assert.deepEqual(await openFolds(), ['The standard and the most used measures', 'Speed'], 'the fold stays open');
  await page.evaluate(() => dispatchEvent(new Event('beforeprint')));
  assert.equal(await page.locator('.fold:not([open])').count(), 0, 'a printout shows all');
  await page.evaluate(() => dispatchEvent(new Event('afterprint')));
  assert.equal((await openFolds()).length, 2);
  await takePictures('03-features');
  await page.unroute(address);
  await page.reload();
  await page.locator('.plots canvas').first().waitFor();
});

/** How many pixels of the overlay are drawn, and a checksum of them. */
const overlay = () =>
  page.evaluate(() => {
    const canvas = document.querySelector('.screen canvas[aria-hidden]');
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    let [drawn, sum] = [0, 0];
    for (let i = 3; i < data.length; i += 4)
      if (data[i]) [drawn, sum] = [drawn + 1, (sum * 31 + i * data[i]) % 1_000_003];
    return { drawn, sum };
  });

const moment = () => page.evaluate(() => document.querySelector('video').currentTime);

test('playing moves the video, the overlay and the playhead in the curves together', async () => {
  const still = await overlay();
  assert.ok(still.drawn > 100, 'the overlay shows the tools');
  const playhead = () =>
    page
      .locator('.playhead')
      .first()
      .evaluate(element => new DOMMatrix(getComputedStyle(element).transform).e);
  const before = await playhead();
  await page.getByRole('button', { name: 'Play', exact: true }).click();
  await page.waitForFunction(() => document.querySelector('video').currentTime > 1);
  await page.getByRole('button', { name: 'Pause', exact: true }).click();
  assert.ok((await playhead()) > before, 'the playhead moved');
  assert.notEqual((await overlay()).sum, still.sum, 'the overlay was redrawn');
  await takePictures('04-played');
});

test('no curve is drawn across missing frames', async () => {
  const frames = await page.evaluate(async () => {
    const { curveFrames } = await import('/parts/playback/track.js');
    return curveFrames({ times: [0, 0.04, 0.2, 2.2, 2.24] });
  });
  assert.deepEqual(frames, [0, 1, 2, null, 3, 4]);
});

test('a click on a curve seeks to that moment, and the keys step by one frame', async () => {
  const curve = page.locator('.plot .u-over').first();
  const box = await curve.boundingBox();
  const length = await page.evaluate(() => document.querySelector('video').duration);
  await curve.click({ position: { x: box.width / 2, y: box.height / 2 } });
  await page.waitForFunction(() => !document.querySelector('video').seeking);
  assert.ok(
    Math.abs((await moment()) - length / 2) < length * 0.02,
    `half of ${length} s, but the video is at ${await moment()} s`,
  );
  const clock = page.locator('.transport .clock');
  const frame = async () => Number(/frame (\d+)/.exec(await clock.innerText())[1]);
  const shows = wanted => clock.filter({ hasText: new RegExp(`frame ${wanted}\\b`) }).waitFor();
  // The middle may be the boundary of two frames; after one step the time lies inside a frame.
  await page.locator('main').press('.');
  await page.waitForFunction(() => !document.querySelector('video').seeking);
  const at = await frame();
  await page.locator('main').press('.');
  await shows(at + 1);
  await page.locator('main').press(',');
  await shows(at);
});

test('a link to a moment opens the video and the curves at this moment', async () => {
  await page.goto(`${url}/sessions/${session}?t=1.5`);
  await page.locator('.plots canvas').first().waitFor();
  await page.waitForFunction(() => Math.abs(document.querySelector('video')?.currentTime - 1.5) < 0.05);
  await page.waitForFunction(
    () => new DOMMatrix(getComputedStyle(document.querySelector('.playhead')).transform).e > 10,
  );
});

test('a feature shows the seconds that determined it, by keyboard, and a click seeks to them', async () => {
  await page.getByRole('button', { name: 'In space', exact: true }).click();
  const { features } = await getJson(`sessions/${session}/evidence`);
  const evidence = features.find(row => row.space === '3d' && row.stretches.length && row.stretches[0].from_s > 0.2);
  const { items } = await getJson('features');
  const title = items.find(feature => feature.name === evidence.feature).title;
  const opener = page.getByRole('button', { name: title, exact: true });
  if (await opener.isHidden()) await page.getByRole('button', { name: 'Show all features' }).click();
  await opener.focus();
  await page.keyboard.press('Enter');
  assert.equal(await opener.getAttribute('aria-expanded'), 'true');
  await page.locator('.seconds .jump').first().click();
  const shown = await page.locator('.seconds .jump').first().innerText();
  await page.waitForFunction(() => !document.querySelector('.plot .marked').hidden);
  const stretch = features.find(
    row => row.feature === evidence.feature && row.space === '3d' && row.stretches.length,
  ).stretches[0];
  await page.waitForFunction(
    second => Math.abs(document.querySelector('video').currentTime - second) < 0.05,
    stretch.from_s,
  );
  assert.match(shown, /^0:0\d\.\d–0:0\d\.\d$/);
  await takePictures('04-seconds');
});

test('a comment is saved as plain text at the current second of the recording, and can be withdrawn', async () => {
  const words = '<b>Look</b> at the left tip.';
  const at = await moment();
  await page.getByLabel('What do you see at this moment?').fill(words);
  await page.getByRole('button', { name: /^Add at/ }).click();
  await page.locator('.comments .said', { hasText: words }).waitFor();
  const { items } = await getJson(`sessions/${session}/comments`);
  assert.ok(Math.abs(items[0].from_s - at) < 0.05, `${items[0].from_s} instead of ${at}`);
  await takePictures('04-comment');
  await page.getByRole('button', { name: /^Withdraw:/ }).click();
  await page.locator('dialog').getByRole('button', { name: 'Withdraw' }).click();
  await page.locator('.comments').waitFor({ state: 'detached' });
});

test('a rating is given with the keyboard, and the page says that a second rater is missing', async () => {
  const form = page.getByRole('region', { name: 'GOALS' });
  await form.getByRole('button', { name: 'Rate', exact: true }).click();
  for (const group of await form.getByRole('group').all()) {
    await group.getByRole('radio', { name: '3' }).focus();
    await page.keyboard.press('Space');
    await page.keyboard.press('ArrowRight');
  }
  await takePictures('04-rating');
  await form.getByRole('button', { name: 'Give this rating' }).click();
  await form.getByText('Rated by you; waiting for a second rater.').waitFor();
  const { items } = await getJson(`sessions/${session}/ratings`);
  assert.deepEqual([items[0].form, items[0].total, items[0].blind], ['goals', 20, true]);
});

let sender;
let arriving;

test('a self-test on the page of a box shows the result in words, and every touch', { skip: !selfTest }, async () => {
  const { box } = await getJson(`sessions/${session}`);
  await page.goto(`${url}/boxes/${box.id}`);
  const card = page.locator('section.card', { has: page.getByRole('heading', { name: 'Self-test', exact: true }) });
  await card.getByText('not tested today').waitFor();
  await card.locator('input[type=file]').setInputFiles(selfTest);
  for (const [label, value] of [['Inner corners, across', 9], ['Inner corners, down', 6], ['Side of a square, mm', 21]])
    await card.getByLabel(label).fill(String(value));
  await card.getByRole('button', { name: 'Test the box' }).click();
  await card.locator('[data-self-test]').waitFor({ timeout: timeoutMs });
  const [result] = (await getJson(`boxes/${box.id}/self-tests`)).items;
  assert.equal(await card.locator('[data-self-test]').getAttribute('data-self-test'), result.light);
  assert.notEqual(result.light, 'red', JSON.stringify(result.parts));
  const words = { green: 'green: all well', yellow: 'yellow: keep an eye on it' }[result.light];
  assert.match(await card.locator('header').innerText(), new RegExp(words));
  assert.equal(await card.locator('.lights li').count(), 1, 'one day so far');
  await card.getByText(/^Every time the rod was held still/).click();
  assert.equal(await card.locator('tbody tr').count(), result.holds.length);
  await checkLooks('box-tested');
  await page.goto(`${url}/boxes`);
  const row = name => page.locator('tbody tr', { has: page.getByRole('rowheader', { name, exact: true }) });
  await row(box.name).getByText(words).waitFor();
  await row('Box 2').getByText('not tested today').waitFor();
});

test('a box that sends live appears on the wall page, with the state of its tools', async () => {
  const { box, trainee, task } = await getJson(`sessions/${session}`);
  sender = await page.context().newPage();
  await sender.goto(url);
  arriving = await beginFeed(sender, { recording: session, box: box.code, trainee: trainee.code, task: task.code });
  await page.goto(`${url}/live`);
  const tile = page.locator('.tile', { hasText: box.name });
  await tile.getByText('Seen').first().waitFor({ timeout: timeoutMs });
  await checkLooks('page-wall');
  assert.equal(pagesOf(await printToPdf('page-wall')), 1);
  await tile.getByRole('link', { name: trainee.name }).click();
  await page.waitForURL(`**/sessions/${arriving}`);
});

test('the page of a session that is being received shows the tips as they move', async () => {
  await page.locator('.live-tool', { hasText: 'Seen' }).first().waitFor({ timeout: timeoutMs });
  let drawn;
  do drawn = await overlay();
  while (drawn.drawn < 100); // When the clip restarts the tools jump, and the tracker rejects them for a moment.
  const position = page.locator('.live-tool.good .position', { hasText: /x\s*−?\d+\.\d\s*± \d+\.\d\s*mm/ }).first();
  await position.waitFor();
  const before = await position.innerText();
  await page.waitForFunction(
    old => document.querySelector('.live-tool.good .position')?.innerText !== old,
    before,
    { timeout: 10_000 },
  );
  await page.locator('.live-features td.number', { hasText: /\d/ }).first().waitFor();
  await checkLooks('page-live');
  assert.notEqual((await overlay()).sum, drawn.sum, 'the overlay was redrawn');
});

test('after the end its page becomes the review page without a reload, live features beside final ones', async () => {
  await page.evaluate(() => (window.notReloaded = true));
  const frames = await endFeed(sender);
  await sender.close();
  await page.locator('.plots canvas').first().waitFor({ timeout: timeoutMs });
  assert.equal(await page.evaluate(() => window.notReloaded), true);
  const arrived = await getJson(`sessions/${arriving}`);
  assert.equal(arrived.video.frames, frames, 'every frame is in the recording');
  await page.getByRole('button', { name: 'In space', exact: true }).click();
  const known = arrived.live_features.filter(feature => feature.value !== null).length;
  assert.equal(await page.locator('.told-live', { hasText: /\d/ }).count(), known);
  await takePictures('05-arrived');
});

test('a trainee’s page compares the sessions with the task’s standard, and says what data are missing', async () => {
  const { trainee, task } = await getJson(`sessions/${session}`);
  const target = { feature: 'duration', by: { method: 'fixed', limit: 60, unit: 's' } };
  await create(`tasks/${task.id}/standards`, { targets: [target], rule: { in_a_row: 3, then_more: 2 } });
  await create('cohorts', { name: 'Everybody' });
  await page.goto(`${url}/trainees/${trainee.id}`);
  const plot = page.locator('svg.progress-plot');
  await plot.waitFor();
  const progress = await getJson(`trainees/${trainee.id}/progress?task=${task.id}&cohort=everybody`);
  const points = progress.features[0].points.filter(point => point.value !== null);
  assert.ok(points.length >= 2, JSON.stringify(progress));
  assert.equal(await plot.locator('.dot').count(), points.length);
  assert.equal(await plot.locator('.dot.pass').count(), points.filter(point => point.judgement === 'pass').length);
  await plot.getByText('limit 60 s').waitFor();
  const said = await page.locator('dl.facts').first().innerText();
  assert.match(said, /Compared with others\s+Not enough data: 10 missing/);
  const known = points.filter(point => !point.is_lower_bound).length;
  assert.match(said, new RegExp(`Learning\\s+Not enough data: ${6 - known} missing`));
  assert.match(said, new RegExp(`So far ${progress.rule.have_in_a_row} of 3 in a row, 0 of 2 more`));
  assert.match(said, /Not shown yet in \d+ judged sessions?\./);
  await page.getByLabel('Feature').selectOption('path_length');
  await page.waitForURL('**feature=path_length**');
  await page.getByLabel('Shown').waitFor();
  await plot.locator('a').first().click();
  await page.waitForURL('**/sessions/*');
});

test('the reports of a session and a trainee print on one side of A4, black on white, with versions', async () => {
  const { trainee, task, versions, features } = await getJson(`sessions/${session}`);
  await page.goto(`${url}/sessions/${session}`);
  await page.getByRole('link', { name: 'Report' }).click();
  await page.waitForURL('**/report');
  for (const [name, path] of [
    ['session', `/sessions/${session}/report`],
    ['trainee', `/trainees/${trainee.id}/report?cohort=everybody`],
  ]) {
    await page.goto(url + path);
    await page.locator('.report svg.progress-plot').first().waitFor();
    await page.getByRole('button', { name: 'Print' }).waitFor();
    const said = await page.locator('.report').innerText();
    for (const words of [trainee.name, trainee.code, task.name, 'at most 60 s', 'version 1', versions.pipeline])
      assert.ok(said.includes(words), `${name} lacks ${words}: ${said}`);
    if (name === 'session') {
      const judged = features.find(feature => feature.target);
      assert.ok(said.includes({ pass: 'Met', fail: 'Missed' }[judged.judgement] ?? 'Undecided'), said);
      assert.ok(said.includes(versions.calibration.slice(-8)) && /SHA-256\s+[0-9a-f]{64}/.test(said), said);
    }
    for (const colorScheme of ['light', 'dark']) {
      await page.emulateMedia({ colorScheme, media: 'print' });
      const look = await page.locator('.report').evaluate(sheet => {
        const { color, backgroundColor } = getComputedStyle(sheet);
        return [color, backgroundColor, getComputedStyle(document.querySelector('.top')).display];
      });
      assert.deepEqual(look, ['rgb(0, 0, 0)', 'rgb(255, 255, 255)', 'none'], colorScheme);
    }
    await page.emulateMedia({ colorScheme: 'light', media: 'screen' });
    assert.equal(pagesOf(await printToPdf(`report-${name}`)), 1, `number of pages of the ${name}’s report`);
  }
});

/** Every page, with the ids of the things that the scenario created. */
async function pages() {
  const { trainee, task, box } = await getJson(`sessions/${session}`);
  const group = (await getJson('groups')).items[0];
  const steps = ['board', 'photos', 'calibration', 'tools', 'colours', 'agent', 'test'];
  return {
    today: '/',
    'wall-empty': '/live',
    sessions: '/sessions',
    session: `/sessions/${session}?t=1.5`,
    record: '/record',
    upload: '/upload',
    trainees: '/trainees',
    trainee: `/trainees/${trainee.id}`,
    'session-report': `/sessions/${session}/report`,
    'trainee-report': `/trainees/${trainee.id}/report`,
    certificate: `/trainees/${trainee.id}/certificate?task=${task.id}`,
    groups: '/groups',
    courses: '/courses',
    'course-new': '/courses/new',
    ...(group && { group: `/groups/${group.id}` }),
    enrol: '/enrol',
    tasks: '/tasks',
    task: `/tasks/${task.id}`,
    boxes: '/boxes',
    box: `/boxes/${box.id}`,
    ...Object.fromEntries(steps.map(step => [`setup-${step}`, `/boxes/${box.id}/setup?step=${step}`])),
    people: '/people',
    service: '/service',
    account: '/account',
    missing: '/there-is-no-such-page',
  };
}

async function openCompletely(name, path) {
  await open(path);
  if (name === 'session') await page.locator('.plots canvas').first().waitFor();
}

test('in every look, every page fits the screen and is accessible', async () => {
  const faults = [];
  for (const [name, path] of Object.entries(await pages())) {
    await openCompletely(name, path);
    await checkLooks(`page-${name}`, async look =>
      faults.push(...(await violationsOf(page)).map(violation => `${name}, ${look.name}: ${violation}`)));
  }
  assert.deepEqual(faults, []);
});

/** For each dialog: the page that contains it, and the button that opens it. */
const dialogs = ({ task, box }) => ({
  'trainee-new': ['/trainees', 'Add a trainee'],
  'trainee-delete': ['/trainees', /^Delete: /],
  'task-new': ['/tasks', 'Add a task'],
  'box-new': ['/boxes', 'Add a box'],
  'box-change': [`/boxes/${box.id}`, /^Edit: /],
  'group-new': ['/groups', 'Add a group'],
  'cohort-new': ['/groups', 'Add a cohort'],
  'person-new': ['/people', 'Add a person'],
  'token-new': ['/people', 'Make a token'],
  raters: [`/tasks/${task.id}`, /^Raters of /],
  rescoring: [`/tasks/${task.id}`, 'Score sessions again'],
  'set-aside': [`/sessions/${session}`, 'Set aside'],
  'session-delete': [`/sessions/${session}`, 'Delete'],
});

test('in every look, every dialog fits the screen, is accessible and closes with Escape', async () => {
  const faults = [];
  for (const [name, [path, button]] of Object.entries(dialogs(await getJson(`sessions/${session}`)))) {
    await open(path);
    const opener = page.getByRole('button', { name: button, exact: true }).first();
    await opener.click();
    const dialog = page.locator('dialog[open]');
    await dialog.waitFor();
    await page.waitForFunction(() => !document.querySelector('dialog .loading'));
    await checkLooks(`dialog-${name}`, async look =>
      faults.push(...(await violationsOf(page)).map(violation => `${name}, ${look.name}: ${violation}`)));
    await page.keyboard.press('Escape');
    await dialog.waitFor({ state: 'detached' });
    assert.equal(await opener.evaluate(element => element === document.activeElement), true, `${name}: the focus returns to the button`);
  }
  assert.deepEqual(faults, []);
});

test('hostile text from people and files stays text on every page', async () => {
  await page.addInitScript(() => {
    window.hits = 0;
    window.hit = () => window.hits++;
  });
  const { task } = await getJson(`sessions/${session}`);
  const refused = await page.evaluate(postEverywhere, { texts: HOSTILE, session, task: task.id });
  assert.deepEqual(refused, []);
  await page.goto(`${url}/upload`);
  for (const label of ['Trainee', 'Task'])
    await page.getByLabel(label, { exact: true }).selectOption({ label: HOSTILE[7] });
  await page.getByLabel('Box', { exact: true }).selectOption({ label: process.env.TROCAR_BOX });
  await page.setInputFiles('.drop input[type=file]', { name: `${HOSTILE[8]}.mp4`, mimeType: 'video/mp4', buffer: hostileClip() });
  const link = page.locator('.sending li', { hasText: 'onerror' }).getByRole('link', { name: 'Open the session' });
  const theirs = new URL(await link.getAttribute('href', { timeout: timeoutMs }), url).pathname.split('/').pop();
  const [{ items: [trainee] }, { items: [box] }] = [await getJson('trainees?limit=1'), await getJson('boxes?limit=1')];
  const more = { hostile: `/sessions/${theirs}`, trainee: `/trainees/${trainee.id}`, report: `/trainees/${trainee.id}/report`,
    box: `/boxes/${box.id}` };
  for (const [name, path] of [...Object.entries(await pages()), ...Object.entries(more)]) {
    await openCompletely(name, path);
    const found = { injectedElements: await injectedElements(page), hits: await page.evaluate(() => window.hits) };
    assert.deepEqual(found, { injectedElements: [], hits: 0 }, name);
  }
});

/** Posts each text to every resource that takes text; returns the requests that were refused. Runs in the page. */
async function postEverywhere({ texts, session, task }) {
  const post = async (path, json) => {
    const answer = await fetch(`/api/v1/${path}`, {
      method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(json) });
    return answer.ok ? [] : [`${path} ${JSON.stringify(json)}: ${answer.status} ${await answer.text()}`];
  };
  const refused = [];
  for (const [number, text] of texts.entries()) {
    const named = { name: text };
    const all = [
      ['trainees', named], ['tasks', { ...named, description: text }], ['boxes', { ...named, view: 'top', notes: text }],
      ['groups', named], ['cohorts', named], ['courses', { ...named, steps: [{ task, sessions: 1 }] }], [`sessions/${session}/comments`, { from_s: 1, text }],
      ['people', { ...named, login: `hostile-${number}`, password: 'a long enough secret', role: 'instructor' }],
    ];
    for (const [path, json] of all) refused.push(...(await post(path, json)));
  }
  return refused;
}

/** The first second of the clip, with hostile texts in the metadata of its container. */
function hostileClip() {
  const said = ['title', 'artist', 'comment', 'description', 'copyright', 'genre'].flatMap((key, number) =>
    ['-metadata', `${key}=${HOSTILE[number]}`]);
  const folder = mkdtempSync(join(tmpdir(), 'hostile-'));
  try {
    const out = join(folder, 'clip.mp4');
    execFileSync('ffmpeg', ['-loglevel', 'error', '-t', '1', '-i', clip, '-c', 'copy', ...said, out]);
    return readFileSync(out);
  } finally {
    rmSync(folder, { recursive: true });
  }
}

test('no page sent a request to another origin, violated the security policy or threw an error', () => {
  assert.deepEqual(pageFaults(), { foreign: [], errors: [] });
});

test('after signing out the next request is refused', async () => {
  await page.goto(`${url}/account`);
  await page.getByRole('button', { name: 'Sign out', exact: true }).click();
  await page.locator('input[name=password]').waitFor();
  assert.equal(await page.evaluate(async () => (await fetch('/api/v1/me')).status), 401);
});
