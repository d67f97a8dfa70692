// The addresses of pages below a path of the host, as behind a proxy. Needs no browser and no service.
import assert from 'node:assert/strict';
import { test } from 'node:test';

const visited = [];
let onClick;
Object.assign(globalThis, {
  document: { documentElement: { dataset: { basePath: '/skills/trocar' } } },
  location: { pathname: '/skills/trocar/sessions/7', search: '?t=3.2' },
  history: { pushState: (_state, _title, address) => visited.push(address) },
  addEventListener: (name, listener) => name === 'click' && (onClick = listener),
  dispatchEvent: () => true,
});
const { currentRoute, go, href } = await import('../../static/router.js');

test('an address of a page begins with the path, and its parts do not', () => {
  assert.equal(href([]), '/skills/trocar/');
  assert.equal(href(['trainees', 'ada'], { task: 'peg' }), '/skills/trocar/trainees/ada?task=peg');
  assert.deepEqual(currentRoute().path, ['sessions', '7']);
  go(['boxes']);
  assert.deepEqual(visited.splice(0), ['/skills/trocar/boxes']);
});

/** Clicks a link to this address. Returns whether the page changed without the browser loading it. */
function isOpenedInPlace(address) {
  let isPrevented = false;
  const link = { target: '', hasAttribute: () => false, getAttribute: () => address };
  onClick({ button: 0, target: { closest: () => link }, preventDefault: () => (isPrevented = true) });
  assert.deepEqual(visited.splice(0), isPrevented ? [address] : []);
  return isPrevented;
}

test('only links to pages below the path change the page in place', () => {
  assert.ok(isOpenedInPlace('/skills/trocar/boxes'));
  for (const other of ['/skills/trocar/api/v1/me', '/skills/trocar/docs/', '/boxes', '/skills/trocars/boxes', '//a.example/b', 'https://a.example'])
    assert.ok(!isOpenedInPlace(other), other);
});
