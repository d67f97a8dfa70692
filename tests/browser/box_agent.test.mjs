// A box that stands by, in a real Chromium: the pages show it live, the dashboard starts and stops a recording, a trainee
// checks in on the box's screen with a PIN and from the phone with the code, a key starts and stops, and the pages show
// that the box fell silent.
//
// Environment: as person.mjs, TROCAR_PROGRAM (the program) and TROCAR_CLIP (what the box's camera sees).
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { connect, createServer } from 'node:net';
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
let publicWay;

before(async () => {
  browser = await launch();
  [admin, trainee, screen] = await Promise.all(['box-agent-', 'box-agent-own-', 'box-agent-screen-'].map(prefix => person(browser, { prefix })));
});

after(async () => {
  agent?.kill('SIGKILL');
  publicWay?.close();
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

/** A way to the service under a name that a phone could open. Returns its address. */
const underPublicName = () =>
  new Promise(done => {
    const { hostname, port: of } = new URL(url);
    publicWay = createServer(from => {
      const to = connect(Number(of), hostname);
      from.once('data', head => {
        to.write(head.toString('latin1').replace(/^host: .*$/im, 'Host: trocar.example'), 'latin1');
        from.pipe(to).pipe(from);
      });
      for (const [one, other] of [[from, to], [to, from]]) one.on('error', () => other.destroy()).on('close', () => other.destroy());
    }).listen(0, '127.0.0.1', () => done(`http://127.0.0.1:${publicWay.address().port}`));
  });

async function standBy({ server = url, more = [] } = {}) {
  port = await freePort();
  const args = ['agent', 'stand-by', ...more, '--server', server, '--box', made.box.code, '--token-file', join(folder, 'token'), '--spool', join(folder, 'spool'), '--screen', String(port)];
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
  await screen.page.getByText('a phone cannot open the address of the server').waitFor();
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
  await waitUntil(async () => {
    await button(screen, 'Start with the first movement').click({ timeout: 500 }).catch(() => {}); // as above
    return (await screenState()).state.awaited_start;
  }, 'the wait for a movement');
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
  await waitUntil(async () => {
    await button(admin, 'Start recording at the box').click({ timeout: 500 }).catch(() => {}); // refused while the clip begins again
    return (await screenState()).state.awaited_start;
  }, 'the wait for a movement');
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
  await button(admin, 'Start recording at the box').waitFor({ timeout: 10_000 }); // leaving the page would cut the request
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

test('the page of the box says why its screen shows no code', async () => {
  await admin.open(`/boxes/${made.box.code}`);
  await admin.page.getByText('The box shows no code for the check-in with the phone').waitFor();
  await admin.takePictures('no-code');
});

test('the screen is in the language of the agent, also what is refused', async () => {
  const gone = new Promise(done => agent.once('exit', done)); // it has the spool until then
  agent.kill('SIGKILL');
  await gone;
  await standBy({ server: await underPublicName(), more: ['--language', 'de', '--require-check-in'] });
  await waitUntil(async () => (await screenState().catch(() => ({}))).check_in_address, 'the address of the code');
  await screen.page.goto(`http://127.0.0.1:${port}/`);
  await screen.page.locator('svg.qr').waitFor();
  assert.equal(await screen.page.locator('html').getAttribute('lang'), 'de');
  await screen.takePictures('code');
  await screen.page.keyboard.press('Space');
  await screen.page.getByText('Diese Box nimmt nichts ohne Namen auf').waitFor();
  await screen.page.route('**/state*', async route => {
    const state = await (await route.fetch()).json();
    state.state.camera = { ...state.state.camera, is_open: false, why: 'the source cannot be opened (Device or resource busy)' };
    Object.assign(state, { is_phone_refused: true, reached_limit: 'space', camera_fault: 'busy', is_connected: false, is_refused: true, trouble: 'the token is not valid (401)' });
    await route.fulfill({ json: state });
  });
  await screen.page.getByText('Die Anmeldung mit dem Telefon wurde abgelehnt').waitFor();
  await screen.page.getByText('Ein anderes Programm dieses Rechners benutzt die Kamera').waitFor();
  assert.equal(await screen.page.locator('[lang=en]').filter({ hasText: 'resource busy' }).count(), 1);
  assert.deepEqual(await violationsOf(screen.page), []);
  await screen.takePictures('refused');
  await screen.page.unrouteAll({ behavior: 'ignoreErrors' });
});

test('a page in German says in German why the box refused', async () => {
  await admin.page.evaluate(() => localStorage.setItem('trocar.language', 'de'));
  await admin.open(`/boxes/${made.box.code}`);
  await admin.page.getByLabel('Lernende/r', { exact: true }).selectOption('unnamed');
  const why = admin.page.getByText('Die Box hat das abgelehnt. Sie zeigt: Melden Sie sich zuerst an: Diese Box nimmt nichts ohne Namen auf.');
  await waitUntil(async () => {
    await button(admin, 'Aufnahme an der Box starten').click({ timeout: 500 }).catch(() => {});
    return why.waitFor({ timeout: 500 }).then(() => true, () => false); // the camera is missing while the clip begins again
  }, 'the refusal');
  assert.equal(await why.evaluate(shown => shown.closest('[lang]').lang), 'de');
  assert.deepEqual(await violationsOf(admin.page), []);
  await admin.takePictures('refused');
  await admin.page.evaluate(() => localStorage.removeItem('trocar.language'));
});

test('a trainee checks in from the phone', async () => {
  await waitUntil(async () => (await screenState()).check_in_address, 'the address of the code');
  const { check_in_address: address } = await screenState();
  await trainee.page.goto(address.replace(/^.*(?=\/check-in)/, url));
  await button(trainee, 'Check in').waitFor();
  const refusal = { type: '/problems/consent-missing', title: 'The trainee does not consent to recordings', status: 403, consent: 'missing' };
  await trainee.page.route('**/check-in', route => (route.request().method() === 'PUT'
    ? route.fulfill({ status: 403, contentType: 'application/problem+json', body: JSON.stringify(refusal) }) : route.continue()));
  await button(trainee, 'Check in').click();
  await trainee.page.getByText('Then scan the code on the screen of the box again.').waitFor();
  assert.deepEqual(await violationsOf(trainee.page), []);
  await trainee.takePictures('no-consent');
  await trainee.page.unrouteAll({ behavior: 'ignoreErrors' });
  await trainee.page.reload();
  await trainee.takePictures('phone');
  await button(trainee, 'Check in').click();
  await trainee.page.getByText(`You are checked in at ${made.box.name}`).waitFor();
  assert.deepEqual(await violationsOf(trainee.page), []);
  await screen.page.getByText(NAME).waitFor({ timeout: 10_000 });
  await button(trainee, 'Check out').click();
  await screen.page.getByText('Wer trainiert?').waitFor({ timeout: 10_000 });
});

test('the pages show that a box fell silent', async () => {
  await admin.open('/boxes');
  const row = admin.page.locator('tr', { hasText: made.box.name });
  await row.getByText('Stands by').waitFor();
  agent.kill('SIGKILL');
  await row.getByText('Silent since').waitFor({ timeout: 10_000 });
});
