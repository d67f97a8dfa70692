// The pages' second language in a real Chromium: somebody finds Deutsch on the sign-in page, signs in with it, sees every page of
// an administrator in it on a desk and on a tablet, signs out and in again, and goes back to English. Other scenarios leave
// sessions behind, and they are looked at here; without any, the pages of a session are left out.
//
// Environment: as person.mjs.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { violationsOf } from './access.mjs';
import { launch } from './chromium.mjs';
import { person, url } from './person.mjs';
import de from '../../static/texts/de.js';
import en from '../../static/texts/en.js';

let browser;
let page, traces, ask, looks, picture, button, heading, signIn, open;

before(async () => {
  browser = await launch();
  ({ page, traces, ask, looks, picture, button, heading, signIn, open } = await person(browser, { prefix: 'language-' }));
});

after(() => browser?.close());

const spoken = (on = page) => on.evaluate(() => document.documentElement.lang);
const navigation = () => page.locator('.top nav a').allInnerTexts();
/** How much of the navigation lies beyond its edge, pixels. */
const hidden = () => page.locator('.top nav').evaluate(nav => nav.scrollWidth - nav.clientWidth);

test('a browser’s own language is taken where it is here, and English where none is', async () => {
  for (const [locale, expected] of [['de-AT', 'de'], ['fr-FR', 'en'], ['en-GB', 'en']]) {
    const context = await browser.newContext({ locale });
    const other = await context.newPage();
    await other.goto(url);
    await other.locator('input[name=login]').waitFor();
    assert.equal(await spoken(other), expected, locale);
    await context.close();
  }
});

test('Deutsch is found and chosen on the sign-in page, which stays where it was', async () => {
  await page.goto(`${url}/sessions?status=done`);
  await page.locator('input[name=login]').waitFor();
  assert.equal(await spoken(), 'en');
  await button('Deutsch').click();
  await button(de.signIn.submit).waitFor();
  assert.deepEqual([await spoken(), new URL(page.url()).search], ['de', '?status=done']);
  assert.equal(await button('Deutsch').getAttribute('aria-pressed'), 'true');
  assert.equal(await button('English').getAttribute('lang'), 'en');
  await picture('sign-in');
  assert.deepEqual(await violationsOf(page), []);
});

test('what the service says by a code is said in German, and what it says in a sentence is marked as English', async () => {
  await signIn('not the password of anybody');
  const notice = page.getByRole('alert');
  const [title, detail] = de.said.problems['wrong-credentials'];
  await notice.getByText(title).waitFor();
  assert.equal(await notice.getByText(detail).getAttribute('lang'), null);
  await signIn();
  await heading(de.sessions.title).waitFor();
  const [{ code }] = (await ask('trainees?limit=1')).items;
  await open('/trainees');
  await button(de.trainees.add).click();
  const dialog = page.locator('dialog');
  await dialog.getByLabel(de.trainees.name, { exact: true }).fill('Wer kommt');
  await dialog.getByLabel(de.trainees.code).fill(code);
  await button(de.form.save).click();
  await dialog.getByRole('alert').getByText(de.said.problems.taken[0]).waitFor();
  assert.equal(await dialog.getByRole('alert').getByText('Choose another').getAttribute('lang'), 'en');
  await picture('taken');
});

test('every page of an administrator is German on a desk and on a tablet, and none is wider than the screen', async () => {
  const first = async (noun, query = '') => (await ask(`${noun}?limit=1${query}`)).items[0];
  const [box, group, session] = [await first('boxes'), await first('groups'), await first('sessions', '&status=done')];
  const trainee = session?.trainee ?? (await first('trainees'));
  const task = session?.task ?? (await first('tasks'));
  const asked = `?task=${task.id}`;
  const pages = {
    today: '/', wall: '/live', sessions: '/sessions', record: '/record', upload: '/upload', trainees: '/trainees', enrol: '/enrol',
    groups: '/groups', courses: '/courses', course: '/courses/new', tasks: '/tasks', boxes: '/boxes', people: '/people', service: '/service', account: '/account',
    missing: '/nothing-is-here', task: `/tasks/${task.id}`, box: `/boxes/${box.id}`, trainee: `/trainees/${trainee.id}${asked}`,
    'trainee-report': `/trainees/${trainee.id}/report${asked}`, certificate: `/trainees/${trainee.id}/certificate${asked}`,
    ...(group && { group: `/groups/${group.id}${asked}` }),
    ...(session && { session: `/sessions/${session.id}`, 'session-report': `/sessions/${session.id}/report` }),
    ...Object.fromEntries(['board', 'photos', 'calibration', 'tools', 'colours', 'agent', 'test'].map(step =>
      [`setup-${step}`, `/boxes/${box.id}/setup?step=${step}`])),
  };
  const english = new Set(Object.values(en.nav).filter(word => !Object.values(de.nav).includes(word)));
  for (const [name, path] of Object.entries(pages)) {
    await open(path);
    assert.equal(await spoken(), 'de');
    const links = await navigation();
    assert.ok(links.length >= 10, `${name} has all of its navigation`);
    assert.deepEqual(links.filter(word => english.has(word.trim())), [], name);
    await looks(name, async look => assert.ok((await hidden()) <= 0, `${name}: the navigation is wider than a ${look.name}`));
  }
});

test('the choice is also beside the theme’s, and outlasts signing out', async () => {
  await open('/account');
  assert.deepEqual(await violationsOf(page), []);
  await button(de.account.signOut).click();
  await button(de.signIn.submit).waitFor();
  await page.reload();
  await button(de.signIn.submit).waitFor();
  assert.equal(await spoken(), 'de');
  await signIn();
  await heading(de.today.title).waitFor();
  await open('/tasks');
  await page.getByRole('combobox', { name: de.language }).selectOption({ label: 'English' });
  await heading(en.tasks.title).waitFor();
  assert.deepEqual([await spoken(), new URL(page.url()).pathname], ['en', '/tasks']);
  assert.ok((await navigation()).includes(en.nav.sessions));
});

test('nothing of another origin was asked for, and nothing broke', () => {
  const { foreign, broken } = traces();
  const refused = /status of 409 .*\/trainees$/; // The code that is taken.
  assert.deepEqual([foreign, broken.filter(line => !refused.test(line))], [[], []]);
});
