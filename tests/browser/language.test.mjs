// German, the pages' second language, in a real Chromium. An administrator chooses Deutsch on the sign-in page, signs
// in, sees every page in German in every look, signs out and in again, and returns to English. If other scenarios have
// left sessions in the centre, the pages of a session are checked too; otherwise they are left out.
//
// Environment: as person.mjs.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { person, url } from './person.mjs';
import de from '../../static/texts/de.js';
import en from '../../static/texts/en.js';

let browser;
let page, pageFaults, getJson, checkLooks, takePictures, button, heading, signIn, open;

before(async () => {
  browser = await launch();
  ({ page, pageFaults, getJson, checkLooks, takePictures, button, heading, signIn, open } = await person(browser, { prefix: 'language-' }));
});

after(() => browser?.close());

const pageLanguage = (on = page) => on.evaluate(() => document.documentElement.lang);
const navigation = () => page.locator('.top nav a').allInnerTexts();
/** How many pixels of the navigation are cut off. */
const hiddenWidth = () => page.locator('.top nav').evaluate(nav => nav.scrollWidth - nav.clientWidth);

test('the pages use the browser’s language if they have it, and English otherwise', async () => {
  for (const [locale, expected] of [['de-AT', 'de'], ['fr-FR', 'en'], ['en-GB', 'en']]) {
    const context = await browser.newContext({ locale });
    const other = await context.newPage();
    await other.goto(url);
    await other.locator('input[name=login]').waitFor();
    assert.equal(await pageLanguage(other), expected, locale);
    await context.close();
  }
});

test('Deutsch can be chosen on the sign-in page, and the address stays the same', async () => {
  await page.goto(`${url}/sessions?status=done`);
  await page.locator('input[name=login]').waitFor();
  assert.equal(await pageLanguage(), 'en');
  await button('Deutsch').click();
  await button(de.signIn.submit).waitFor();
  assert.deepEqual([await pageLanguage(), new URL(page.url()).search], ['de', '?status=done']);
  assert.equal(await button('Deutsch').getAttribute('aria-pressed'), 'true');
  assert.equal(await button('English').getAttribute('lang'), 'en');
  await takePictures('sign-in');
  assert.deepEqual(await violationsOf(page), []);
});

test('the pages translate the service’s codes into German', async () => {
  await signIn('a wrong password');
  const notice = page.getByRole('alert');
  const [title, detail] = de.said.problems['wrong-credentials'];
  await notice.getByText(title).waitFor();
  assert.equal(await notice.getByText(detail).getAttribute('lang'), null);
  await signIn();
  await heading(de.sessions.title).waitFor();
  const [{ code }] = (await getJson('trainees?limit=1')).items;
  await open('/trainees');
  await button(de.trainees.add).click();
  const dialog = page.locator('dialog');
  await dialog.getByLabel(de.trainees.name, { exact: true }).fill('Wer kommt');
  await dialog.getByLabel(de.trainees.code).fill(code);
  await button(de.form.save).click();
  await dialog.getByRole('alert').getByText(de.said.problems.taken[0]).waitFor();
  assert.equal(await dialog.getByRole('alert').getByText(de.said.problems.taken[1]).getAttribute('lang'), null);
  await takePictures('taken');
});

test('in every look, every page of an administrator is German and fits the screen', async () => {
  const first = async (noun, query = '') => (await getJson(`${noun}?limit=1${query}`)).items[0];
  const [box, group, session] = [await first('boxes'), await first('groups'), await first('sessions', '&status=done')];
  const trainee = session?.trainee ?? (await first('trainees'));
  const task = session?.task ?? (await first('tasks'));
  const query = `?task=${task.id}`;
  const pages = {
    today: '/', wall: '/live', sessions: '/sessions', record: '/record', upload: '/upload', trainees: '/trainees', enrol: '/enrol',
    groups: '/groups', courses: '/courses', course: '/courses/new', tasks: '/tasks', boxes: '/boxes', people: '/people', service: '/service', account: '/account',
    missing: '/nothing-is-here', task: `/tasks/${task.id}`, box: `/boxes/${box.id}`, trainee: `/trainees/${trainee.id}${query}`,
    'trainee-report': `/trainees/${trainee.id}/report${query}`, certificate: `/trainees/${trainee.id}/certificate${query}`,
    ...(group && { group: `/groups/${group.id}${query}` }),
    ...(session && { session: `/sessions/${session.id}`, 'session-report': `/sessions/${session.id}/report` }),
    ...Object.fromEntries(['board', 'photos', 'calibration', 'tools', 'colours', 'agent', 'test'].map(step =>
      [`setup-${step}`, `/boxes/${box.id}/setup?step=${step}`])),
  };
  const english = new Set(Object.values(en.nav).filter(word => !Object.values(de.nav).includes(word)));
  for (const [name, path] of Object.entries(pages)) {
    await open(path);
    assert.equal(await pageLanguage(), 'de');
    const links = await navigation();
    assert.ok(links.length >= 10, `${name} has all of its navigation`);
    assert.deepEqual(links.filter(word => english.has(word.trim())), [], name);
    await checkLooks(name, async look => assert.ok((await hiddenWidth()) <= 0, `${name}: the navigation is wider than a ${look.name}`));
  }
});

test('the language can also be chosen beside the theme, and the choice survives signing out', async () => {
  await open('/account');
  assert.deepEqual(await violationsOf(page), []);
  await button(de.account.signOut).click();
  await button(de.signIn.submit).waitFor();
  await page.reload();
  await button(de.signIn.submit).waitFor();
  assert.equal(await pageLanguage(), 'de');
  await signIn();
  await heading(de.today.title).waitFor();
  await open('/tasks');
  await page.getByRole('combobox', { name: de.language }).selectOption({ label: 'English' });
  await heading(en.tasks.title).waitFor();
  assert.deepEqual([await pageLanguage(), new URL(page.url()).pathname], ['en', '/tasks']);
  assert.ok((await navigation()).includes(en.nav.sessions));
});

test('no page sent a request to another origin, violated the security policy or threw an error', () => {
  const { foreign, errors } = pageFaults();
  const refused = /status of 409 .*\/trainees$/; // The trainee code is taken.
  assert.deepEqual([foreign, errors.filter(line => !refused.test(line))], [[], []]);
});
