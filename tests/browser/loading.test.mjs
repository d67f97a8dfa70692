// Pages over a slow line, with nothing kept from before: when they are first painted, when they say what they are, how far anything
// moves under the reader's eyes. And what is asked for at once is what the pages import: one module too few is a round trip more.
//
// Environment: as person.mjs; TROCAR_FIRST_PAINT_MS (the latest first paint; told without it, not judged: a busy machine paints late).
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { after, before, test } from 'node:test';
import { fileURLToPath } from 'node:url';

import { launch, LOOKS } from './chromium.mjs';
import { ask, signIn, url } from './person.mjs';
import { secured } from './secure.mjs';

const latest = Number(process.env.TROCAR_FIRST_PAINT_MS ?? Infinity);
/** 1.6 Mbit/s and 150 ms to and fro: a phone at the edge of a cell. */
const LINE = { offline: false, latency: 150, downloadThroughput: 1.6e6 / 8, uploadThroughput: 0.75e6 / 8 };
const MOST_SHIFT = 0.02;
const SETTLED_MS = 2_000;
const STATIC = join(dirname(fileURLToPath(import.meta.url)), '../../static');

let browser;
let proxy;
let signedIn;
let session;

before(async () => {
  proxy = await secured(url);
  browser = await launch();
  const context = await browser.newContext();
  const page = await context.newPage();
  await page.goto(url);
  await signIn(page);
  await page.locator('header.top nav').waitFor();
  signedIn = await context.storageState();
  session = (await ask(page, 'sessions?status=done&limit=1')).items[0]?.id;
  await context.close();
});

after(async () => {
  await browser?.close();
  proxy?.close();
});

/** Opens an address over the slow line until `shows` is there, and again; returns what was measured, ms after the address was asked
 *  for. */
async function opened(address, shows, storageState) {
  const context = await browser.newContext({ ...LOOKS[0], storageState, ignoreHTTPSErrors: true });
  const page = await context.newPage();
  const line = await context.newCDPSession(page);
  await line.send('Network.enable');
  await line.send('Network.emulateNetworkConditions', LINE);
  await page.addInitScript(selector => {
    window.measured = { shift: 0, moved: [] };
    new PerformanceObserver(list => {
      for (const entry of list.getEntries())
        if (!entry.hadRecentInput) {
          measured.shift += entry.value;
          measured.moved.push(...entry.sources.map(({ node }) => `${node?.nodeName}.${node?.className}`));
        }
    }).observe({ type: 'layout-shift', buffered: true });
    const look = () => {
      if (document.querySelector(selector)) measured.shown = Math.round(performance.now());
      else requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
  }, shows);
  const abandoned = [];
  let isLeaving = false; // Then what is still under way is given up, and rightly.
  page.on('requestfailed', request => !isLeaving && request.resourceType() === 'fetch' && abandoned.push(request.url()));
  const visits = [];
  for (const _ of ['first', 'again']) {
    isLeaving = true;
    await page.goto('about:blank'); // Else the second were a reload, which asks for everything.
    isLeaving = false;
    await page.goto(address);
    await page.locator(shows).first().waitFor();
    await page.waitForFunction(() => !document.querySelector('main .loading'));
    await page.waitForTimeout(SETTLED_MS); // What comes later may still push something aside.
    visits.push(await page.evaluate(measure));
  }
  isLeaving = true;
  await context.close();
  assert.deepEqual(abandoned, [], 'was asked for, and given up');
  return visits;
}

/** In the page. */
function measure() {
  const entries = performance.getEntriesByType('resource');
  return {
    ...window.measured,
    painted: Math.round(performance.getEntriesByName('first-contentful-paint')[0].startTime),
    asked: entries.filter(entry => entry.transferSize > 0).map(entry => new URL(entry.name).pathname),
    bytes: entries.reduce((sum, entry) => sum + entry.transferSize, 0),
  };
}

const PAGES = [
  ['sign-in', () => '/', 'input[name=login]', false],
  ['today', () => '/', '.figures', true],
  ['session', () => `/sessions/${session}`, '.review', true],
];
// A browser keeps nothing of an origin whose certificate it does not trust.
const ORIGINS = [
  ['the service itself', () => url, true],
  ['a TLS proxy', () => proxy.url, false],
];

for (const [name, path, shows, isSignedIn] of PAGES)
  for (const [origin, root, isKept] of ORIGINS)
    test(`${name} from ${origin} over a slow line: first painted, then shown, and nothing moves`, async t => {
      if (name === 'session' && !session) return t.skip('nothing is scored in this centre');
      const [first, again] = await opened(root() + path(), shows, isSignedIn ? signedIn : undefined);
      for (const [visit, { painted, shown, shift, moved, asked, bytes }] of Object.entries(isKept ? { first, again } : { first })) {
        console.log(`${name} from ${origin}, ${visit}: first painted after ${painted} ms, shown after ${shown} ms, shift ${shift.toFixed(4)}, ${asked.length} requests, ${bytes} bytes`);
        assert.ok(shift < MOST_SHIFT, `${visit}: moved by ${shift}: ${moved.join(', ')}`);
        assert.ok(painted <= shown, `${visit}: painted first after ${painted} ms, what it is after ${shown} ms`);
        assert.ok(painted <= latest, `${visit}: first painted after ${painted} ms`);
      }
      if (isKept) assert.deepEqual(again.asked.filter(path => path.startsWith('/kept/')), [], 'is asked for again');
    });

test('a style that failed before app.js runs is asked for again, and one that never comes holds no page up', async () => {
  const page = await browser.newPage({ storageState: signedIn });
  let asked = 0;
  const [failed, again] = [page.waitForEvent('requestfailed'), page.waitForResponse('**/styles/centre.css')];
  await page.route('**/styles/centre.css', route => (asked++ ? route.continue() : route.abort()));
  await page.route('**/styles/report.css', () => {}); // Never answered.
  await page.route('**/app.js', async route => (await failed, route.continue()));
  await page.goto(url, { waitUntil: 'commit' });
  await page.locator('.figures').waitFor();
  await again;
  await page.close();
});

/** A module and all that it imports, from the first line to the last, as paths below static/. */
function importsOf(entry) {
  const found = new Set([entry]);
  for (const name of found) // Grows as it is read.
    for (const [, from] of readFileSync(join(STATIC, name), 'utf8').matchAll(/^(?:(?:import|export)\b[^;'()]*\bfrom |import )'(\.[^']+)'/gm))
      found.add(join(dirname(name), from));
  return found;
}

test('what is asked for at once is what app.js and the pages import', () => {
  const index = readFileSync(join(STATIC, 'index.html'), 'utf8');
  const asked = [...index.matchAll(/rel="modulepreload" href="\/kept\/VERSION\/([^"]+)"/g)].map(([, name]) => name);
  const shared = importsOf('app.js');
  assert.deepEqual([...asked, 'app.js'].sort(), [...shared].sort(), 'index.html');
  const script = readFileSync(join(STATIC, 'modules_first.js'), 'utf8');
  const languages = [...script.match(/LANGUAGES = \[(.*)\]/)[1].matchAll(/'(\w+)'/g)].map(([, name]) => `${name}.js`);
  assert.deepEqual(languages.sort(), readdirSync(join(STATIC, 'texts')).sort(), 'modules_first.js, languages');
  for (const [, page, names] of script.matchAll(/^ {4}(\w+): `([^`]+)`/gm)) {
    const listed = names.trim().split(/\s+/).filter(name => !name.startsWith('vendor/'));
    const imported = [...importsOf(`pages/${page}.js`)].filter(name => !shared.has(name));
    assert.deepEqual(listed.sort(), imported.sort(), `modules_first.js, ${page}`);
  }
});
