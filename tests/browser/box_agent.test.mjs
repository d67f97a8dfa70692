// A box that stands by, in a real Chromium: the pages show it live, the dashboard starts and stops a recording, a trainee
// checks in on the box's screen with a PIN and from the phone with the code, a key starts and stops, and the pages show
// that the box fell silent.
//
// Environment: as person.mjs, TROCAR_PROGRAM (the program) and TROCAR_CLIP (what the box's camera sees).
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { person, requiredEnv, url, waitUntil } from './person.mjs';

const mark = Date.now().toString(36); // So that the scenario can run again in the same centre.
const NAME = `Nia Pedal ${mark}`;
const SECRET = 'a password at the box';
const folder = mkdtempSync(join(tmpdir(), 'trocar-box-'));
const made = {};

let browser;
let admin;
let trainee;
let screen;
let agent;
let port;

before(async () => {
  browser = await launch();
  [admin, trainee, screen] = await Promise.all(['box-agent-', 'box-agent-own-', 'box-agent-screen-'].map(prefix => person(browser, { prefix })));
});

after(async () => {
  agent?.kill('SIGKILL');
  await browser?.close();
  rmSync(folder, { recursive: true });
});

/** A port that is free now. */
const freePort = () =>
  new Promise(done => {
    const server = createServer().listen(0, '127.0.0.1', () => {
      const { port: free } = server.address();
      server.close(() => done(free));
    });
  });

async function standBy() {
  port = await freePort();
  const args = ['agent', 'stand-by', '--server', url, '--box', made.box.code, '--token-file', join(folder, 'token'), '--spool', join(folder, 'spool'), '--screen', String(port)];
  agent = spawn(requiredEnv('TROCAR_PROGRAM'), [...args, requiredEnv('TROCAR_CLIP')], { stdio: ['ignore', 'ignore', 'inherit'] });
}

const button = (of, name) => of.page.getByRole('button', { name, exact: true });
const screenState = async () => (await fetch(`http://127.0.0.1:${port}/state`)).json();
const agentState = () => admin.page.evaluate(async at => (await fetch(at)).json(), `/api/v1/boxes/${made.box.code}/agent`);

test('the pages show a box that stands by', async () => {
  await admin.page.goto(url);
  await admin.signIn();
  await admin.page.locator('header.top nav').waitFor();
  made.box = await admin.create('boxes', { name: `Pedal box ${mark}` });
  made.task = await admin.create('tasks', { name: `Pedal pegs ${mark}` });
  made.nia = await admin.create('trainees', { name: NAME });
  await admin.create('people', { login: `nia-${mark}`, name: NAME, role: 'trainee', password: SECRET, trainee: made.nia.id });
  const token = await admin.create('tokens', { name: `beside ${made.box.code}`, role: 'agent', box: made.box.id });
  writeFileSync(join(folder, 'token'), token.token, { mode: 0o600 });
  await admin.open('/boxes');
  const row = admin.page.locator('tr', { hasText: made.box.name });
  await row.getByText('No agent').waitFor();
  await standBy();
  await row.getByText('Stands by').waitFor({ timeout: 10_000 });
  await admin.takePictures('boxes');
});

test('the dashboard starts and stops a recording', async () => {
  await admin.open(`/boxes/${made.box.code}`);
  await admin.page.getByText('exposure held').or(admin.page.getByText(/frames per second/)).waitFor();
  await admin.page.getByLabel('Trainee', { exact: true }).selectOption(made.nia.id);
  await admin.page.getByLabel('Task', { exact: true }).selectOption(made.task.id);
  await button(admin, 'Start recording at the box').click();
  await admin.page.getByText(`Records ${NAME}`).waitFor({ timeout: 10_000 });
  assert.deepEqual(await violationsOf(admin.page), []);
  await admin.takePictures('records');
  await waitUntil(async () => (await agentState()).recording?.frames > 10, 'some frames');
  await button(admin, 'Stop recording').click();
  await button(admin, 'Start recording at the box').waitFor({ timeout: 10_000 });
});

test('a trainee checks in with a PIN, and a key starts and stops', async () => {
  await trainee.page.goto(`${url}/account`);
  await trainee.signIn(SECRET, `nia-${mark}`);
  await trainee.page.getByText('PIN for the box').waitFor();
  await trainee.page.fill('[name=pin]', '2580');
  await button(trainee, 'Set the PIN').click();
  await trainee.page.getByText('The PIN was set.').waitFor();
  await screen.page.goto(`http://127.0.0.1:${port}/`);
  await screen.page.locator('svg.qr').waitFor();
  assert.deepEqual(await violationsOf(screen.page), []);
  await screen.takePictures('check-in');
  await screen.page.fill('[name=trainee]', made.nia.code);
  await screen.page.fill('[name=pin]', '2581');
  await button(screen, 'Check in').click();
  await screen.page.getByText('The code or the PIN is wrong').waitFor();
  await screen.page.fill('[name=pin]', '2580');
  await button(screen, 'Check in').click();
  await button(screen, made.task.name).click();
  await screen.page.locator('.press:enabled').waitFor();
  await screen.takePictures('ready');
  await waitUntil(async () => {
    await screen.page.keyboard.press('Space'); // ignored for a second after the last press, refused while the clip begins again
    return (await screenState()).state.recording;
  }, 'the recording');
  await screen.page.locator('.elapsed').waitFor();
  await screen.takePictures('records');
  await waitUntil(async () => (await screenState()).state.recording?.session, 'the session of the recording');
  await screen.page.getByText(/[2-9][0-9] frames/).waitFor();
  await waitUntil(async () => {
    await screen.page.keyboard.press('Space'); // ignored for a second after the last press
    return !(await screenState()).state.recording;
  }, 'the end of the recording');
  await screen.page.getByText(`Last recording, ${made.task.name}`).waitFor();
  await screen.takePictures('last');
});

test('a recording waits for the first movement until the trainee, or another page, ends the wait', async () => {
  await button(screen, 'Start with the first movement').click();
  await screen.page.getByText('Hold still').waitFor();
  await button(screen, 'Start now').waitFor();
  assert.deepEqual(await violationsOf(screen.page), []);
  await screen.takePictures('awaits');
  await admin.open('/boxes');
  await admin.page.locator('tr', { hasText: made.box.name }).getByText('Waits for a movement').waitFor();
  await admin.open(`/boxes/${made.box.code}`);
  await admin.page.getByText(`Waits for the first movement of ${NAME}`).waitFor();
  await admin.takePictures('awaits');
  await button(admin, 'Do not wait any more').click();
  await button(screen, 'Start with the first movement').waitFor();
  await admin.page.getByText('Waits for the first movement').waitFor({ state: 'detached' });
  await admin.page.getByLabel('Trainee', { exact: true }).selectOption(made.nia.id);
  await admin.page.getByLabel('Task', { exact: true }).selectOption(made.task.id);
  await admin.page.getByLabel('Begin with the first movement').check();
  assert.deepEqual(await violationsOf(admin.page), []);
  await button(admin, 'Start recording at the box').click();
  await button(screen, 'Do not wait any more').click();
  await admin.page.getByText('Waits for the first movement').waitFor({ state: 'detached' });
  await button(screen, 'Check out').click();
  await screen.page.getByText('Who trains?').waitFor();
});

test('without a check-in a recording waits for a name', async () => {
  await screen.page.getByText('Who trains?').waitFor();
  await waitUntil(async () => {
    await screen.page.keyboard.press('Space'); // ignored for a second after the last press
    return (await screenState()).state.recording;
  }, 'the recording');
  await screen.page.getByText('Without a name', { exact: true }).waitFor();
  await screen.takePictures('unnamed');
  await admin.open(`/boxes/${made.box.code}`);
  await admin.page.getByText('Records without a name').waitFor({ timeout: 10_000 });
  await admin.takePictures('unnamed');
  await waitUntil(async () => (await agentState()).recording?.frames > 10, 'some frames');
  await button(admin, 'Stop recording').click();
  await screen.page.getByText('The last recording waits for a name.').waitFor({ timeout: 10_000 });
  assert.deepEqual(await violationsOf(screen.page), []);
  await screen.takePictures('waits');
  await admin.page.getByLabel('Trainee', { exact: true }).selectOption('unnamed');
  await button(admin, 'Start recording at the box').click();
  await admin.page.getByText('Records without a name').waitFor({ timeout: 10_000 });
  await button(admin, 'Stop recording').click();
  await admin.open('/waiting?source=agent');
  await admin.page.getByText(`${made.box.code} 20`).first().waitFor({ timeout: 10_000 });
  await admin.takePictures('waiting');
});

test('after a check-in that was ended, the pedal starts no recording without a name, and the button does', async () => {
  const gone = await admin.create('trainees', { name: `Gone ${mark}` });
  const send = (path, method, body) =>
    admin.page.evaluate(
      async ([at, how, what]) => (await fetch(at, { method: how, headers: { 'content-type': 'application/json' }, body: what && JSON.stringify(what) })).ok,
      [path, method, body],
    );
  await waitUntil(async () => !(await screenState()).state.recording, 'the end of the recording');
  assert.ok(await send(`/api/v1/boxes/${made.box.code}/check-in`, 'PUT', { trainee: gone.id }));
  await screen.page.getByText(`Gone ${mark}`).waitFor();
  assert.ok(await send(`/api/v1/trainees/${gone.id}`, 'DELETE'));
  await screen.page.getByText('The check-in has ended, because the record was changed').waitFor();
  await waitUntil(async () => {
    await screen.page.keyboard.press('Space'); // ignored for a second after the last press
    return screen.page.getByText('Key and pedal do not start now').isVisible();
  }, 'the refusal');
  assert.deepEqual(await violationsOf(screen.page), []);
  await screen.takePictures('needs-button');
  await waitUntil(async () => {
    await button(screen, 'Record without a name').click({ timeout: 500 }).catch(() => {}); // as above
    return (await screenState()).state.recording;
  }, 'the recording');
  await screen.page.getByText('Without a name', { exact: true }).waitFor();
  await waitUntil(async () => {
    await screen.page.keyboard.press('Space');
    return !(await screenState()).state.recording;
  }, 'the end of the recording');
});

test('a trainee checks in from the phone', async () => {
  await waitUntil(async () => (await screenState()).check_in_address, 'the address of the code');
  const { check_in_address: address } = await screenState();
  await trainee.page.goto(address);
  await button(trainee, 'Check in').waitFor();
  await trainee.takePictures('phone');
  await button(trainee, 'Check in').click();
  await trainee.page.getByText(`You are checked in at ${made.box.name}`).waitFor();
  assert.deepEqual(await violationsOf(trainee.page), []);
  await screen.page.getByText(NAME).waitFor({ timeout: 10_000 });
  await button(trainee, 'Check out').click();
  await screen.page.getByText('Who trains?').waitFor({ timeout: 10_000 });
});

test('the pages show that a box fell silent', async () => {
  await admin.open('/boxes');
  const row = admin.page.locator('tr', { hasText: made.box.name });
  await row.getByText('Stands by').waitFor();
  agent.kill('SIGKILL');
  await row.getByText('Silent since').waitFor({ timeout: 10_000 });
});
