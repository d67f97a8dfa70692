// Many tabs of one browser, computers that several people use, and addresses that are not secure.
//
// Environment: as person.mjs.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { launch } from './chromium.mjs';
import { getJson, login, open, password, signIn, url, waitUntil } from './person.mjs';

/** A name that Chromium does not take for this machine, so that its address is not secure. */
const OTHER_HOST = 'trocar.test';
const TABS = 12;
/** How long a tab may take, ms: with a stream for each tab, the sixth never loaded. */
const LOAD_MS = 10_000;

let browser;

before(async () => {
  browser = await launch([`--host-resolver-rules=MAP ${OTHER_HOST} 127.0.0.1`]);
});

after(() => browser?.close());

/** Runs `use(context, page)` in a browser of its own, signed in. */
async function withBrowser(use) {
  const context = await browser.newContext();
  try {
    const page = await context.newPage();
    await page.goto(`${url}/tasks`);
    await signIn(page);
    await page.locator('main h1', { hasText: 'Tasks' }).waitFor();
    await use(context, page);
  } finally {
    await context.close();
  }
}

async function streams() {
  const metrics = await (await fetch(`${url}/metrics`)).text();
  return Number(/^trocar_event_streams (\d+)/m.exec(metrics)[1]);
}

/** The address of a tab; none of them shows a recording live. */
const PATHS = ['/sessions', '/tasks', '/trainees', '/boxes'];

test('twelve tabs load, and share one stream of events', () =>
  withBrowser(async (context, first) => {
    await waitUntil(async () => (await streams()) > 0, 'the stream of the first tab');
    const before = await streams();
    const tabs = [first];
    while (tabs.length < TABS) {
      const tab = await context.newPage();
      await tab.goto(url + PATHS[tabs.length % PATHS.length], { timeout: LOAD_MS });
      await tab.locator('main h1').waitFor({ timeout: LOAD_MS });
      await tab.waitForFunction(() => !document.querySelector('main .loading'), null, { timeout: LOAD_MS });
      tabs.push(tab);
    }
    assert.equal((await streams()) - before, 0, 'streams of the further tabs');
  }));

test('after the tab with the stream is closed, another one takes it over, and no change is missed', () =>
  withBrowser(async (context, first) => {
    const second = await context.newPage();
    await open(second, '/');
    await second.locator('.pill', { hasText: 'Live' }).waitFor();
    const count = await streams();
    await first.close();
    await waitUntil(async () => (await streams()) === count, 'the stream of the second tab');
    await second.locator('.pill', { hasText: 'Live' }).waitFor();
    const [trainee, task, box] = await Promise.all(['trainees', 'tasks', 'boxes'].map(async kind => (await getJson(second, kind)).items[0].id));
    await second.evaluate(address => fetch(address, { method: 'POST', headers: { 'Content-Type': 'video/mp4' }, body: new Uint8Array(1000).fill(7) }),
      `/api/v1/sessions?trainee=${trainee}&task=${task}&box=${box}&filename=tabs.mp4`);
    await second.getByText('tabs.mp4').first().waitFor({ timeout: LOAD_MS });
  }));

/**
 * Hides the page, or shows it again, as its scripts see it. A tab that Playwright opened is never hidden by itself.
 */
const setHidden = (page, isHidden) =>
  page.evaluate(hidden => {
    Object.defineProperty(document, 'hidden', { configurable: true, value: hidden });
    Object.defineProperty(document, 'visibilityState', { configurable: true, value: hidden ? 'hidden' : 'visible' });
    document.dispatchEvent(new Event('visibilitychange'));
  }, isHidden);

const waitForStreams = (count, what) => waitUntil(async () => (await streams()) === count, what);

test('a hidden page closes its stream, and shows what has changed when it is shown again', () =>
  withBrowser(async (_, page) => {
    await open(page, '/');
    const live = page.locator('.pill', { hasText: 'Live' });
    await live.waitFor();
    await waitForStreams(1, 'one stream: those of earlier pages have ended');
    await setHidden(page, true);
    await waitForStreams(0, 'the end of the stream of a hidden page');
    const [trainee, task, box] = await Promise.all(['trainees', 'tasks', 'boxes'].map(async kind => (await getJson(page, kind)).items[0].id));
    await page.evaluate(address => fetch(address, { method: 'POST', headers: { 'Content-Type': 'video/mp4' }, body: new Uint8Array(1000).fill(8) }),
      `/api/v1/sessions?trainee=${trainee}&task=${task}&box=${box}&filename=hidden.mp4`);
    assert.equal(await page.getByText('hidden.mp4').count(), 0, 'a hidden page does not follow');
    await setHidden(page, false);
    await live.waitFor();
    await page.getByText('hidden.mp4').first().waitFor({ timeout: LOAD_MS });
    await waitForStreams(1, 'the stream of the page that is shown again');
    // A page in the back/forward cache gets these events, and no others.
    await page.evaluate(() => dispatchEvent(new PageTransitionEvent('pagehide', { persisted: true })));
    await waitForStreams(0, 'the end of the stream of a page that was left');
    await page.evaluate(() => dispatchEvent(new PageTransitionEvent('pageshow', { persisted: true })));
    await waitForStreams(1, 'the stream of a page that was returned to');
  }));

test('when the tab with the stream is hidden, a tab that is shown takes the stream over', () =>
  withBrowser(async (context, first) => {
    const second = await context.newPage();
    await open(second, '/');
    const live = second.locator('.pill', { hasText: 'Live' });
    await live.waitFor();
    await setHidden(first, true); // it was there first, and has the stream
    await waitForStreams(1, 'the stream of the second tab');
    await live.waitFor();
    await setHidden(second, true);
    await waitForStreams(0, 'the end of all streams');
  }));

test('pages that are left for another address hold no stream', () =>
  withBrowser(async (_, page) => {
    const before = await streams();
    for (const path of [...PATHS, ...PATHS]) {
      await page.goto(url + path, { timeout: LOAD_MS });
      await page.locator('main h1').waitFor({ timeout: LOAD_MS });
    }
    await waitUntil(async () => (await streams()) === before, 'the end of the streams of pages that were left');
  }));

test('after signing out nothing of a person’s uploads stays in the browser', () =>
  withBrowser(async (_, page) => {
    await open(page, '/upload');
    const stored = () => page.evaluate(() => JSON.stringify(Object.entries(localStorage)));
    for (const label of ['Trainee', 'Task', 'Box'])
      if (!(await page.getByLabel(label, { exact: true }).inputValue()))
        await page.getByLabel(label, { exact: true }).selectOption({ index: 1 });
    const name = await page.getByLabel('Trainee', { exact: true }).evaluate(select => select.selectedOptions[0].textContent);
    await page.route('**/api/v1/uploads**', route => route.abort()); // it stays unfinished
    await page.setInputFiles('.drop input[type=file]', { name: 'unfinished.mp4', mimeType: 'video/mp4', buffer: Buffer.alloc(1000) });
    await page.locator('.sending li', { hasText: 'unfinished.mp4' }).waitFor();
    assert.match(await stored(), /unfinished\.mp4/);
    assert.ok(!(await stored()).includes(name), 'a trainee’s name is stored');
    await open(page, '/account');
    await page.getByRole('button', { name: 'Sign out', exact: true }).click();
    await page.locator('input[name=login]').waitFor();
    assert.doesNotMatch(await stored(), /unfinished\.mp4/);
  }));

test('the account page lists the sign-ins of the account, and ends another one', () =>
  withBrowser(async (_, page) => {
    await withBrowser(async (__, elsewhere) => {
      await open(page, '/account');
      const other = page.locator('section', { hasText: 'Signed in here' }).getByRole('button', { name: /Sign out there/ });
      await page.getByText('This browser').waitFor();
      while (await other.count()) {
        const left = await other.count();
        await other.first().click();
        await waitUntil(async () => (await other.count()) < left, 'the end of a sign-in');
      }
      await elsewhere.reload();
      await elsewhere.locator('input[name=login]').waitFor();
    });
  }));

test('at an address that is not secure the sign-in page says why signing in does not work, and what to do', async () => {
  const context = await browser.newContext();
  const page = await context.newPage();
  await page.goto(url.replace('127.0.0.1', OTHER_HOST));
  await page.getByText('Signing in does not work at this address').waitFor();
  await page.fill('input[name=login]', login);
  await page.fill('input[name=password]', password);
  await page.click('button[type=submit]');
  await page.getByText('The password is right, but this browser did not keep the sign-in').waitFor();
  await context.close();
});
