// Loads pages over a slow network with an empty cache, and measures the first paint, the time until the content is
// shown, and the layout shift. Also checks that the preloaded modules are those that the pages import: each module
// missing from the list costs one more round trip.
//
// Environment: as person.mjs. Optional: TROCAR_FIRST_PAINT_MS (limit for the first paint; without it the time is
// printed but not checked, because a busy machine paints late).
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { after, before, test } from 'node:test';
import { fileURLToPath } from 'node:url';

import { launch, LOOKS } from './chromium.mjs';
import { getJson, signIn, url } from './person.mjs';
import { startTlsProxy } from './tls_proxy.mjs';

const maxFirstPaintMs = Number(process.env.TROCAR_FIRST_PAINT_MS ?? Infinity);
/** 1.6 Mbit/s down and a round trip of 150 ms: a phone at the edge of a cell. */
const SLOW_NETWORK = { offline: false, latency: 150, downloadThroughput: 1.6e6 / 8, uploadThroughput: 0.75e6 / 8 };
const MAX_SHIFT = 0.02;
const SETTLED_MS = 2_000;
const STATIC = join(dirname(fileURLToPath(import.meta.url)), '../../static');

let browser;
let proxy;
let signedIn;
let session;

before(async () => {
  proxy = await startTlsProxy(url);
  browser = await launch();
  const context = await browser.newContext();
  const page = await context.newPage();
  await page.goto(url);
  await signIn(page);
  await page.locator('header.top nav').waitFor();
  signedIn = await context.storageState();
  session = (await getJson(page, 'sessions?status=done&limit=1')).items[0]?.id;
  await context.close();
});

after(async () => {
  await browser?.close();
  proxy?.close();
});

/**
 * Opens an address twice over the slow network, each time until the element `shows` appears. Returns the measurements
 * of both visits; times are in ms after navigation began.
 */
async function measureVisits(address, shows, storageState) {
  const context = await browser.newContext({ ...LOOKS[0], storageState, ignoreHTTPSErrors: true });
  const page = await context.newPage();
  const devtools = await context.newCDPSession(page);
  await devtools.send('Network.enable');
  await devtools.send('Network.emulateNetworkConditions', SLOW_NETWORK);
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
  let isLeaving = false; // On leaving a page the browser may abort its requests.
  page.on('requestfailed', request => !isLeaving && request.resourceType() === 'fetch' && abandoned.push(request.url()));
  const visits = [];
  for (const _ of ['first', 'again']) {
    isLeaving = true;
    await page.goto('about:blank'); // Otherwise the second visit is a reload, which requests everything.
    isLeaving = false;
    await page.goto(address);
    await page.locator(shows).first().waitFor();
    await page.waitForFunction(() => !document.querySelector('main .loading'));
    await page.waitForTimeout(SETTLED_MS); // Late content may still shift the layout.
    visits.push(await page.evaluate(measure));
  }
  isLeaving = true;
  await context.close();
  assert.deepEqual(abandoned, [], 'these requests were aborted');
  return visits;
}

/** Runs in the page: reads the measurements of a visit. */
function measure() {
  const entries = performance.getEntriesByType('resource');
  return {
    ...window.measured,
    painted: Math.round(performance.getEntriesByName('first-contentful-paint')[0].startTime),
    requested: entries.filter(entry => entry.transferSize > 0).map(entry => new URL(entry.name).pathname),
    bytes: entries.reduce((sum, entry) => sum + entry.transferSize, 0),
  };
}

const PAGES = [
  ['sign-in', () => '/', 'input[name=login]', false],
  ['today', () => '/', '.figures', true],
  ['session', () => `/sessions/${session}`, '.review', true],
];
// A browser does not cache files of an origin whose certificate it does not trust.
const ORIGINS = [
  ['the service itself', () => url, true],
  ['a TLS proxy', () => proxy.url, false],
];

for (const [name, path, shows, isSignedIn] of PAGES)
  for (const [origin, root, isCached] of ORIGINS)
    test(`${name} from ${origin} over a slow network: painted before it is shown, and the layout does not shift`, async t => {
      if (name === 'session' && !session) return t.skip('this centre has no scored session');
      const [first, again] = await measureVisits(root() + path(), shows, isSignedIn ? signedIn : undefined);
      for (const [visit, { painted, shown, shift, moved, requested, bytes }] of Object.entries(isCached ? { first, again } : { first })) {
        console.log(`${name} from ${origin}, ${visit}: first painted after ${painted} ms, shown after ${shown} ms, shift ${shift.toFixed(4)}, ${requested.length} requests, ${bytes} bytes`);
        assert.ok(shift < MAX_SHIFT, `${visit}: moved by ${shift}: ${moved.join(', ')}`);
        assert.ok(painted <= shown, `${visit}: first painted after ${painted} ms, but shown after ${shown} ms`);
        assert.ok(painted <= maxFirstPaintMs, `${visit}: first painted after ${painted} ms`);
      }
      const requestedAgain = again.requested.filter(path => path.startsWith('/kept/'));
      if (isCached) assert.deepEqual(requestedAgain, [], 'the second visit requests no cached file');
    });

test('a style sheet that failed before app.js ran is requested again; one that never loads blocks no page', async () => {
  const page = await browser.newPage({ storageState: signedIn });
  let requests = 0;
  const [failed, again] = [page.waitForEvent('requestfailed'), page.waitForResponse('**/styles/centre.css')];
  await page.route('**/styles/centre.css', route => (requests++ ? route.continue() : route.abort()));
  await page.route('**/styles/report.css', () => {}); // Never answered.
  await page.route('**/app.js', async route => (await failed, route.continue()));
  await page.goto(url, { waitUntil: 'commit' });
  await page.locator('.figures').waitFor();
  await again;
  await page.close();
});

/** A module and all modules that it imports, directly or indirectly, as paths below static/. */
function importsOf(entry) {
  const found = new Set([entry]);
  for (const name of found) // The set grows while the loop runs.
    for (const [, from] of readFileSync(join(STATIC, name), 'utf8').matchAll(/^(?:(?:import|export)\b[^;'()]*\bfrom |import )'(\.[^']+)'/gm))
      found.add(join(dirname(name), from));
  return found;
}

test('the preloaded modules are those that app.js and the pages import', () => {
  const index = readFileSync(join(STATIC, 'index.html'), 'utf8');
  const preloaded = [...index.matchAll(/rel="modulepreload" href="BASE_PATH\/kept\/VERSION\/([^"]+)"/g)].map(([, name]) => name);
  const shared = importsOf('app.js');
  assert.deepEqual([...preloaded, 'app.js'].sort(), [...shared].sort(), 'index.html');
  const script = readFileSync(join(STATIC, 'modules_first.js'), 'utf8');
  const languages = [...script.match(/LANGUAGES = \[(.*)\]/)[1].matchAll(/'(\w+)'/g)].map(([, name]) => `${name}.js`);
  assert.deepEqual(languages.sort(), readdirSync(join(STATIC, 'texts')).sort(), 'modules_first.js, languages');
  for (const [, page, names] of script.matchAll(/^ {4}(\w+): `([^`]+)`/gm)) {
    const listed = names.trim().split(/\s+/).filter(name => !name.startsWith('vendor/'));
    const imported = [...importsOf(`pages/${page}.js`)].filter(name => !shared.has(name));
    assert.deepEqual(listed.sort(), imported.sort(), `modules_first.js, ${page}`);
  }
});
