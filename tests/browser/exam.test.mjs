// An exam in a real Chromium: planned, started in a box that passed its self-test, recorded by the agent of the box, closed
// and certified. The candidate sees no figure before it is closed, and a stranger reads what the certificate says.
//
// Environment: as person.mjs, TROCAR_PROGRAM, TROCAR_CLIP (what the box's camera sees), TROCAR_SELF_TEST (a clip of the same
// box with a board of 9x6 corners and 21 mm), TROCAR_BOX (the name of the box).
import assert from 'node:assert/strict';
import { execFileSync, spawn } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { person, requiredEnv, timeoutMs, url, waitUntil } from './person.mjs';

const mark = Date.now().toString(36); // So that the scenario can run again in the same centre.
const NAME = `Edda Berg ${mark}`;
const SECRET = 'a password of a candidate';
const folder = mkdtempSync(join(tmpdir(), 'trocar-exam-'));
const made = {};

let browser;
let admin;
let candidate;
let agent;

before(async () => {
  browser = await launch();
  [admin, candidate] = await Promise.all(['exam-', 'exam-own-'].map(prefix => person(browser, { prefix })));
});

after(async () => {
  agent?.kill('SIGKILL');
  await browser?.close();
  rmSync(folder, { recursive: true });
});

const button = (of, name) => of.page.getByRole('button', { name, exact: true });
const examAddress = () => new URL(admin.page.url()).pathname;

async function testBox() {
  await admin.page.getByRole('link', { name: `Self-test of ${made.box.name}` }).click();
  const card = admin.page.locator('section.card', { has: admin.page.getByRole('heading', { name: 'Self-test', exact: true }) });
  await card.locator('input[type=file]').setInputFiles(requiredEnv('TROCAR_SELF_TEST'));
  for (const [label, value] of [['Inner corners, across', 9], ['Inner corners, down', 6], ['Side of a square, mm', 21]])
    await card.getByLabel(label).fill(String(value));
  await card.getByRole('button', { name: 'Test the box' }).click();
  await card.locator('[data-self-test]').waitFor({ timeout: timeoutMs });
}

/** Records an attempt at the box for three seconds, and waits for its judgement. */
async function recordAttempt(at) {
  await button(admin, `Record attempt ${at} at the box`).click({ timeout: timeoutMs });
  await admin.page.locator('.pill', { hasText: 'Recording' }).waitFor({ timeout: timeoutMs });
  await waitUntil(async () => (await admin.getJson(`boxes/${made.box.id}/agent`)).recording?.frames > 75, 'three seconds of frames');
  await admin.takePictures('recording');
  await button(admin, 'End the recording').click();
  const attempt = async () => (await admin.getJson(made.exam.slice(1))).attempts[at - 1];
  await waitUntil(async () => (await attempt()).state === 'judged', 'the judgement');
  assert.equal((await attempt()).outcome, 'passed', JSON.stringify(await attempt()));
  await admin.page.locator('article', { hasText: `Attempt ${at}` }).locator('.pill', { hasText: 'Passed' }).waitFor();
}

async function voidFirst() {
  await button(admin, 'Void attempt').click();
  const dialog = admin.page.locator('dialog');
  await dialog.getByLabel('Technical failure').fill('The lamp failed.');
  await dialog.getByRole('button', { name: 'Void attempt' }).click();
  await admin.page.getByRole('heading', { name: 'Attempt 1 (declared void)' }).waitFor();
  await admin.page.getByText('One attempt is left.').waitFor();
  assert.equal(await admin.page.locator('article .pill.good').count(), 0);
}

test('staff plan an exam, and it starts only in a box that was tested today', async () => {
  await admin.page.goto(url);
  await admin.signIn();
  await admin.page.locator('header.top nav').waitFor();
  made.box = (await admin.getJson('boxes?limit=200')).items.find(box => box.name === requiredEnv('TROCAR_BOX'));
  made.task = await admin.create('tasks', { name: `Exam pegs ${mark}` });
  // No time: a recording that begins and ends in a movement has only a least duration, which passes no limit.
  const [{ tools }] = (await admin.getJson(`boxes/${made.box.id}/palettes`)).items;
  const targets = [{ feature: 'jitter', tool: tools[0].name, by: { method: 'fixed', limit: 1_000_000, unit: 'mm/s²' } }];
  await admin.create(`tasks/${made.task.id}/standards`, { targets });
  made.edda = await admin.create('trainees', { name: NAME });
  await admin.create('people', { login: `edda-${mark}`, name: NAME, role: 'trainee', password: SECRET, trainee: made.edda.id });
  const token = await admin.create('tokens', { name: `exam ${mark}`, role: 'agent', box: made.box.id });
  writeFileSync(join(folder, 'token'), token.token, { mode: 0o600 });
  await admin.open('/trainees');
  await admin.page.getByRole('link', { name: 'Exams', exact: true }).click();
  await button(admin, 'Plan exam').click();
  const dialog = admin.page.locator('dialog');
  await dialog.getByLabel('Trainee').selectOption(made.edda.id);
  await dialog.getByLabel('Task').selectOption(made.task.id);
  await dialog.getByLabel('Box').selectOption(made.box.id);
  await admin.takePictures('plan');
  await dialog.getByRole('button', { name: 'Plan exam' }).click();
  await admin.page.locator('.pill', { hasText: 'Planned' }).waitFor();
  made.exam = examAddress();
  const ready = admin.page.getByText('The box passed its self-test today');
  const unready = admin.page.getByText('The box needs a self-test first');
  await ready.or(unready).waitFor();
  if (await unready.count()) {
    assert.equal(await button(admin, 'Start exam').count(), 0);
    await admin.takePictures('box-not-ready');
    await testBox();
    await admin.open(made.exam);
  }
  await ready.waitFor();
  await admin.page.getByLabel('Identity confirmed by').selectOption('badge');
  assert.deepEqual(await violationsOf(admin.page), []);
  await admin.checkLooks('start');
  await button(admin, 'Start exam').click();
  await admin.page.getByText('The exam is running').waitFor();
});

test('the agent of the box records the attempt, and the candidate sees no figure', async () => {
  const args = ['agent', 'stand-by', '--server', url, '--box', made.box.code, '--token-file', join(folder, 'token'), '--spool', join(folder, 'spool')];
  const camera = join(folder, 'camera.mp4'); // Without the end of the clip, which would be a camera that is pulled out.
  execFileSync('ffmpeg', ['-v', 'error', '-stream_loop', '40', '-i', requiredEnv('TROCAR_CLIP'), '-c', 'copy', camera]);
  agent = spawn(requiredEnv('TROCAR_PROGRAM'), [...args, camera], { stdio: ['ignore', 'ignore', 'inherit'] });
  await waitUntil(async () => (await admin.getJson(`boxes/${made.box.id}/agent`)).camera?.is_open, 'the camera of the box');
  await recordAttempt(1);
  await voidFirst();
  await recordAttempt(2); // It keeps its number when the candidate has one attempt only.
  await admin.page.locator('td', { hasText: 'at most 1,000,000 mm/s²' }).last().waitFor();
  assert.ok(await button(admin, 'Close exam').isDisabled());
  await button(admin, 'Completed').click();
  await admin.page.getByText('The examiner says that it was completed.').waitFor();
  await admin.page.getByText('If you close the exam now, its result is: Passed.').waitFor();
  await admin.checkLooks('judged');
  await candidate.page.goto(url + made.exam);
  await candidate.signIn(SECRET, `edda-${mark}`);
  await candidate.page.getByText('The exam is not closed yet').waitFor();
  assert.equal(await candidate.page.locator('table').count(), 0);
  await candidate.takePictures('sealed');
  await candidate.open('/sessions');
  await candidate.page.locator('main h1').waitFor();
  assert.deepEqual((await candidate.getJson('sessions')).items, []);
});

test('the exam is closed, the candidate sees the result, and the certificate says that it is of an exam', async () => {
  await button(admin, 'Close exam').click();
  await admin.page.locator('dialog').getByRole('button', { name: 'Close exam' }).click();
  await admin.page.getByText('An attempt was completed and met all limits').waitFor();
  await candidate.open(made.exam);
  await candidate.page.getByText('An attempt was completed and met all limits').waitFor();
  await candidate.page.locator('td', { hasText: 'at most 1,000,000 mm/s²' }).last().waitFor();
  await candidate.takePictures('closed');
  await candidate.page.getByRole('link', { name: 'Session', exact: true }).last().click();
  await candidate.page.getByText('This is attempt 2 of an exam').waitFor();
  await button(admin, 'Issue certificate').click();
  await button(admin, 'Issue with this address').click(); // The test's service has a local address.
  await admin.page.locator('.certificates .pill', { hasText: 'Valid' }).waitFor();
  await admin.takePictures('certified');
  const [certificate] = (await admin.getJson(`certificates?trainee=${made.edda.id}`)).items;
  const stranger = await person(browser, { prefix: 'exam-stranger-' });
  await stranger.page.goto(`${url}/verify/${certificate.content.code}`);
  await stranger.page.getByText('in an exam').waitFor();
  await stranger.page.getByText('badge with a photo').waitFor();
  await stranger.page.getByText('1 of 1 attempt used, attempt 1 declared void').waitFor();
  await stranger.takePictures('verify');
  assert.deepEqual(await violationsOf(stranger.page), []);
  await admin.open('/exams?state=closed');
  await admin.page.locator('.pill', { hasText: 'Passed' }).first().waitFor();
  await admin.takePictures('list');
  const unconfirmed = /status of 409 .*\/certificates$/; // The address works only here.
  for (const one of [admin, candidate, stranger]) {
    const { foreign, errors } = one.pageFaults();
    assert.deepEqual([foreign, errors.filter(line => !unconfirmed.test(line))], [[], []]);
  }
});
