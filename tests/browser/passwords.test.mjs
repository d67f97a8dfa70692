// How people get their passwords, in a real Chromium. An administrator adds a person, who chooses a password with the
// link; and one with a typed password, who must choose another before anything else.
//
// Environment: as person.mjs.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { person, url, waitUntil } from './person.mjs';

const mark = Date.now().toString(36); // So that the scenario can run again in the same centre.
const [GIVEN, OWN] = ['a password that was given', 'a password of my own'];
const PASSWORD_PAGE = 'Choose your password';

let browser, administrator;

before(async () => {
  browser = await launch();
  administrator = await person(browser, { prefix: 'passwords-' });
  await administrator.page.goto(`${url}/people`);
  await administrator.signIn();
  await administrator.heading('People').waitFor();
});

after(() => browser?.close());

/** Adds an instructor on the page *People*; `password` is typed there, without it the person gets a link. */
async function addPerson(name, login, password) {
  const { page, button } = administrator;
  await button('Add a person').click();
  const dialog = page.locator('dialog[open]');
  await dialog.getByLabel('Name', { exact: true }).fill(name);
  await dialog.getByLabel('Sign-in name').fill(login);
  if (password) {
    await dialog.getByLabel('First sign-in').selectOption('password');
    await dialog.getByLabel('Password', { exact: true }).fill(password);
  }
  await button('Save').click();
  await page.locator('tr', { hasText: login }).waitFor();
}

async function choose(page, fresh) {
  await page.getByLabel('New password', { exact: true }).fill(fresh);
  await page.getByLabel('New password, again').fill(fresh);
  await page.getByRole('button', { name: 'Set password' }).click();
}

test('a new person chooses a password with a link, which works once', async () => {
  const [name, login] = [`Invited ${mark}`, `invited-${mark}`];
  await addPerson(name, login);
  const { page, button } = administrator;
  const shown = page.locator('dialog[open]');
  await shown.getByText('it is shown only once').waitFor();
  const link = await shown.locator('.secret').innerText();
  assert.match(link, /\/choose-password#[\w-]{43}$/);
  await button('Close').click();
  await page.locator('tr', { hasText: login }).getByText('no password yet').waitFor();
  const links = page.locator('section', { hasText: 'Password links' }).last();
  await links.getByText(name).waitFor();

  const invited = await person(browser, { prefix: 'passwords-' });
  const requested = [];
  invited.page.on('request', request => requested.push(request.url(), request.headers().referer ?? ''));
  await invited.page.goto(link);
  await invited.page.getByText(name).waitFor();
  assert.equal(await invited.page.getByLabel('Sign-in name').inputValue(), login);
  await invited.takePictures('link');
  await choose(invited.page, '111111111111');
  await invited.page.getByText('fewer than 5 different characters').waitFor();
  await choose(invited.page, OWN);
  await invited.heading('Today').waitFor();
  assert.equal(invited.page.url(), `${url}/`);
  const secret = link.split('#')[1];
  assert.deepEqual(requested.filter(address => address.includes(secret)), [], 'addresses that contain the secret');

  await invited.page.goto(link);
  await invited.page.getByText('Ask your instructor or an administrator for a new one').waitFor();
  await invited.button('Go to the sign-in page').click();
  await invited.heading('Today').waitFor(); // still signed in
  await page.reload();
  await page.locator('tr', { hasText: login }).waitFor();
  assert.equal(await page.locator('tr', { hasText: login }).getByText('no password yet').count(), 0);
  await invited.page.context().close();
});

test('a link is withdrawn on the page', async () => {
  const { page, button } = administrator;
  const name = `Withdrawn ${mark}`;
  await addPerson(name, `withdrawn-${mark}`);
  const link = await page.locator('dialog[open] .secret').innerText();
  await button('Close').click();
  const withdraw = page.getByRole('button', { name: `Withdraw: ${name}` });
  await withdraw.click();
  await waitUntil(async () => (await withdraw.count()) === 0, 'the end of the link');
  const stranger = await person(browser);
  await stranger.page.goto(link);
  await stranger.page.getByText('Ask your instructor or an administrator for a new one').waitFor();
  await stranger.button('Go to the sign-in page').click();
  await stranger.page.locator('input[name=login]').waitFor();
  await stranger.page.context().close();
});

test('a person with a given password chooses another one before seeing anything', async () => {
  const [name, login] = [`Given ${mark}`, `given-${mark}`];
  await addPerson(name, login, GIVEN);
  await administrator.page.locator('tr', { hasText: login }).getByText('must change the password').waitFor();
  const given = await person(browser, { prefix: 'passwords-' });
  const { page } = given;
  await page.goto(`${url}/tasks`);
  await given.signIn(GIVEN, login);
  await given.heading(PASSWORD_PAGE).waitFor();
  assert.equal(await page.getByLabel('The password that you were given').count(), 0, 'it was typed a moment ago');
  assert.deepEqual(await violationsOf(page), []);
  await given.checkLooks('first');
  await page.goto(`${url}/sessions`);
  await given.heading(PASSWORD_PAGE).waitFor();
  assert.equal((await given.getJson('sessions')).type, '/problems/password-change-required');
  await page.getByLabel('The password that you were given').fill(GIVEN);
  await choose(page, GIVEN);
  await page.locator('.notice.bad').waitFor();
  await choose(page, OWN);
  await given.heading('Sessions').waitFor();
  assert.ok((await given.getJson('sessions')).items);
  await page.context().close();
});

test('on the account page a wrong old password changes nothing, and a new one withdraws the tokens and ends other sign-ins', async () => {
  const login = `own-${mark}`;
  await administrator.create('people', { name: `Own ${mark}`, login, role: 'administrator', password: GIVEN });
  const { page, signIn, create, button } = await person(browser, { prefix: 'passwords-' });
  await page.goto(`${url}/account`);
  await signIn(GIVEN, login);
  await page.getByText('This browser').waitFor();
  const elsewhere = await person(browser);
  await elsewhere.page.goto(`${url}/tasks`);
  await elsewhere.signIn(GIVEN, login);
  await elsewhere.heading('Tasks').waitFor();
  await create('tokens', { name: 'a nightly program', role: 'instructor' });
  await page.reload();
  const token = page.locator('li', { hasText: 'a nightly program' });
  await token.getByText('never used').waitFor();
  const change = async old => {
    await page.getByLabel('Old password').fill(old);
    await page.getByLabel('New password', { exact: true }).fill(OWN);
    await page.getByLabel('New password, again').fill(OWN);
    await button('Change the password').click();
  };
  await change('not the old password');
  await page.locator('.notice.bad').waitFor();
  assert.equal(await token.count(), 1, 'the person is still signed in');
  await change(GIVEN);
  await page.getByText('The password is changed.').waitFor();
  await page.getByText('No tokens').waitFor();
  await page.reload();
  await page.getByText('This browser').waitFor(); // still signed in
  const ends = page.locator('section', { hasText: 'Signed in here' }).getByRole('button', { name: /Sign out there/ });
  assert.equal(await ends.count(), 0, 'other sign-ins');
  assert.equal(await page.getByText('The password is changed.').count(), 0);
  await elsewhere.page.reload();
  await elsewhere.page.locator('input[name=login]').waitFor();
  await elsewhere.signIn(OWN, login);
  await elsewhere.heading('Tasks').waitFor();
  await elsewhere.page.context().close();
  await page.context().close();
});
