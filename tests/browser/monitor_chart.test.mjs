// The charts that monitor a trainee's sessions, drawn without a browser.
import assert from 'node:assert/strict';
import { test } from 'node:test';

Object.assign(globalThis, {
  localStorage: { getItem: () => 'en' },
  navigator: { languages: ['en'] },
  document: { documentElement: { dataset: {} } },
});
const { MonitorCharts } = await import('../../static/parts/charts/monitor_chart.js');

/** Every element below a node, with components replaced by what they draw. */
function elements(node) {
  if (Array.isArray(node)) return node.flatMap(elements);
  if (!node?.type) return [];
  if (typeof node.type === 'function') return elements(node.type(node.props));
  return [node, ...elements(node.props.children)];
}

/** The x of the dots, in the order of judging. */
function dotsOf(numbers) {
  const path = numbers.map((session, at) => ({ session, learning: true, score: at / 10 }));
  const drawn = elements(MonitorCharts({ charts: { path, events: [], declares_at: 2, alarms_at: 2 } }));
  const dots = drawn.filter(({ type }) => type === 'circle').map(({ props }) => Number(props.cx));
  const [line] = drawn.filter(({ type }) => type === 'polyline');
  assert.deepEqual(line.props.points.split(' ').map(point => Number(point.split(',')[0])), dots);
  assert.ok(dots.every(x => x >= 44 && x <= 650), `${dots} are on the chart`);
  return { dots, texts: drawn.filter(({ type }) => type === 'text').map(({ props }) => String(props.children)) };
}

test('a chart never goes back, even if stated times contradict the order of arrival', () => {
  for (const numbers of [[1, 2, 3], [3, 1, 2], [9, 2, 1, 7], [5]]) {
    const { dots } = dotsOf(numbers);
    assert.ok(dots.every((x, at) => at === 0 || x > dots[at - 1]), `${numbers}: ${dots}`);
  }
});

test('sessions in order stand at their numbers, so that one that does not count leaves a gap', () => {
  const { dots, texts } = dotsOf([1, 2, 4]);
  assert.ok(Math.abs(dots[2] - dots[1] - 2 * (dots[1] - dots[0])) < 1e-6, `${dots}`);
  assert.ok(texts.includes('Session') && !texts.some(text => text.includes('arrival')), texts.join());
  assert.ok(dotsOf([2, 1]).texts.some(text => text.includes('arrival')));
});
