// Single sign-on in a real Chromium with a real OpenID Connect provider, which the test starts: sign in and out at both,
// the role of the group, a changed and an unknown group, a cancelled and a forged answer, linking.
//
// The service is one of its own, since its settings name the provider. Provider and service have different host names,
// so that for the browser they are two sites.
//
// Environment: TROCAR_PROGRAM (the program), and that of person.mjs, whose screenshots it uses.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';

import Provider from 'oidc-provider';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { requiredEnv, takePictures } from './person.mjs';

const CLIENT = { client_id: 'trocar', client_secret: 'a-secret-of-the-browser-tests-with-length' };
const PASSWORD = 'a password of the sign-on test';
/** The groups of each account at the provider. @type {Record<string, string[]>} */
const groups = { ines: ['teachers'], ada: ['students'], eve: ['cleaners'], root: [] };

let browser, folder, service, url, server, isForged;

before(async () => {
  browser = await launch();
  folder = mkdtempSync(join(tmpdir(), 'trocar-sso-'));
  let answer;
  const ready = new Promise(done => (answer = done)); // The provider needs the address of the service, and the reverse.
  server = createServer(async (request, response) => (await ready)(request, response));
  await new Promise(done => server.listen(0, 'localhost', done));
  const issuer = `http://localhost:${server.address().port}`;
  url = await startService(issuer);
  answer(provider(issuer).callback());
  await until(async () => (await post('single-sign-on/start', {})).ok, 'the service knows the provider');
});

after(async () => {
  await browser?.close();
  service?.kill();
  server?.close();
  server?.closeAllConnections();
  if (folder) rmSync(folder, { recursive: true, force: true });
});

async function startService(issuer) {
  writeFileSync(join(folder, 'secret'), CLIENT.client_secret);
  const settings = `[single_sign_on]
issuer = "${issuer}"
client_id = "${CLIENT.client_id}"
client_secret_file = "${join(folder, 'secret')}"
name = "Test hospital"
[single_sign_on.roles]
admins = "administrator"
teachers = "instructor"
students = "trainee"
`;
  writeFileSync(join(folder, 'settings.toml'), settings);
  const { PATH } = process.env;
  const data = join(folder, 'data');
  const args = ['serve', '--data', data, '--settings', join(folder, 'settings.toml'), '--listen', '127.0.0.1:0', '--log', 'warn'];
  service = spawn(requiredEnv('TROCAR_PROGRAM'), args, { env: { PATH }, stdio: ['ignore', 'pipe', 'inherit'] });
  let output = '';
  service.stdout.on('data', text => (output += text));
  await until(() => /http:\/\/[\d.:]+/.test(output), 'the service has started');
  return output.match(/http:\/\/[\d.:]+/)[0];
}

function provider(issuer) {
  const made = new Provider(issuer, {
    clients: [{ ...CLIENT, redirect_uris: [`${url}/single-sign-on`], post_logout_redirect_uris: [`${url}/`] }],
    findAccount: (_ctx, id) => ({ accountId: id, claims: () => ({ sub: id, name: `Name of ${id}`, preferred_username: id, groups: groups[id] }) }),
    claims: { profile: ['name', 'preferred_username', 'groups'], email: ['email'] },
    cookies: { keys: ['for-tests-only'] },
  });
  made.use(async (ctx, next) => {
    await next();
    if (!isForged || ctx.path !== '/token') return;
    const [head, , signature] = ctx.body.id_token.split('.');
    const claims = JSON.parse(Buffer.from(ctx.body.id_token.split('.')[1], 'base64url').toString());
    const forged = Buffer.from(JSON.stringify({ ...claims, sub: 'root', groups: ['admins'] })).toString('base64url');
    ctx.body = { ...ctx.body, id_token: `${head}.${forged}.${signature}` };
  });
  return made;
}

const post = (path, json, headers = {}) =>
  fetch(`${url}/api/v1/${path}`, { method: 'POST', headers: { 'content-type': 'application/json', ...headers }, body: JSON.stringify(json) });

async function until(condition, what) {
  const end = Date.now() + 30_000;
  while (!(await condition())) {
    assert.ok(Date.now() < end, `${what}: not in time`);
    await new Promise(done => setTimeout(done, 50));
  }
}

/** A browser that has no sign-in yet, in this language. */
async function newPage(locale = 'en') {
  const context = await browser.newContext({ locale, viewport: { width: 1440, height: 900 } });
  await context.route(address => !['127.0.0.1', 'localhost'].includes(address.hostname), route => route.abort());
  return context.newPage();
}

/** Signs in at the provider as this account, on the page that the button leads to. */
async function signInAtProvider(page, account) {
  await page.waitForURL(address => address.hostname === 'localhost'); // both pages have a field `login`
  await page.locator('input[name=login]').fill(account);
  await page.locator('input[name=password]').fill('any');
  await page.getByRole('button', { name: 'Sign-in' }).click();
  await page.getByRole('button', { name: 'Continue' }).click();
}

async function signIn(page, account, path = '/') {
  await page.goto(url + path);
  await page.getByRole('button', { name: 'Sign in with Test hospital' }).click();
  await signInAtProvider(page, account);
}

test('a person signs in with the role of the group, and out at both', async () => {
  const page = await newPage();
  await page.goto(`${url}/boxes?shown=all`);
  await page.getByRole('button', { name: 'Sign in with Test hospital' }).waitFor();
  assert.deepEqual(await violationsOf(page), []);
  await takePictures(page, 'single-sign-on-sign-in');
  await signIn(page, 'ines', '/boxes?shown=all');
  await page.locator('main h1', { hasText: 'Boxes' }).waitFor();
  assert.equal(page.url(), `${url}/boxes?shown=all`);
  await page.goto(`${url}/account`);
  await page.getByText('Instructor', { exact: true }).first().waitFor();
  await page.getByText(/the role follows the groups there/).waitFor();
  assert.equal(await page.getByText('Old password').count(), 0, 'the account has no password');
  await takePictures(page, 'single-sign-on-account');

  groups.ines = ['teachers', 'admins'];
  const other = await newPage();
  await signIn(other, 'ines', '/people');
  await other.locator('main h1', { hasText: 'People' }).waitFor();
  await other.locator('tr', { hasText: 'ines' }).getByText('Single sign-on').waitFor();
  await takePictures(other, 'single-sign-on-people');

  await other.goto(`${url}/account`);
  await other.getByRole('button', { name: 'Sign out', exact: true }).click();
  await other.getByRole('button', { name: 'Yes, sign me out' }).click();
  await other.getByRole('button', { name: 'Sign in with Test hospital' }).click();
  await other.waitForURL(address => address.hostname === 'localhost');
  await other.locator('input[name=login]').waitFor(); // the provider asks again
  await other.getByRole('link', { name: 'Cancel' }).click();
  await other.getByText('You cancelled the sign-in').waitFor();
  assert.deepEqual(await violationsOf(other), []);
  await takePictures(other, 'single-sign-on-cancelled');
  await other.getByRole('button', { name: 'Back' }).click();
  await other.getByLabel('Sign-in name').waitFor();

  groups.ines = ['teachers'];
});

test('an unknown group, a forged answer and a used one sign no person in', async () => {
  const page = await newPage('de');
  await page.goto(url);
  await page.getByRole('button', { name: 'Anmelden mit Test hospital' }).click();
  await signInAtProvider(page, 'eve');
  await page.getByText('Sie haben hier noch keinen Zugang').waitFor();
  await takePictures(page, 'single-sign-on-no-group');
  await page.reload();
  await page.getByText('Diese Anmeldung gilt nicht mehr').waitFor();

  isForged = true;
  const forger = await newPage();
  await signIn(forger, 'ines');
  await forger.getByText('could not be verified').waitFor();
  isForged = false;
  assert.equal((await forger.request.get(`${url}/api/v1/me`)).status(), 401);
});

test('a person with a password links the account, and an administrator removes the link', async () => {
  const first = readFileSync(join(folder, 'data', 'administrator.password'), 'utf8').match(/^password: (.+)$/m)[1];
  const signedIn = await post('sign-in', { login: 'administrator', password: first });
  const cookie = signedIn.headers.getSetCookie()[0].split(';')[0];
  const made = await post('people', { login: 'omar', name: 'Omar', role: 'instructor', password: PASSWORD }, { cookie });
  assert.equal(made.status, 201);
  const page = await newPage();
  await page.goto(`${url}/account`);
  await page.getByLabel('Sign-in name').fill('omar');
  await page.getByLabel('Password').fill(PASSWORD);
  await page.getByRole('button', { name: 'Sign in', exact: true }).click();
  await page.getByLabel('Your password here').fill(PASSWORD);
  await page.getByRole('button', { name: 'Link with Test hospital' }).click();
  groups.omar = ['students'];
  await signInAtProvider(page, 'omar');
  await page.getByText(/linked; the role is set here/).waitFor();
  await page.getByText('Instructor', { exact: true }).first().waitFor();

  const again = await newPage();
  await signIn(again, 'omar', '/account');
  await again.getByText('Instructor', { exact: true }).first().waitFor();
  await page.getByRole('button', { name: 'Remove: omar' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Remove' }).click();
  await page.getByRole('button', { name: 'Link with Test hospital' }).waitFor();
  assert.equal((await again.request.get(`${url}/api/v1/me`)).status(), 401, 'its sign-in ended with the link');
});
