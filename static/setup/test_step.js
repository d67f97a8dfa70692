// Step 7: the self-test of a minute, which tells whether all of it came right.
import { html } from '../parts/preact.js';
import { t } from '../texts.js';
import { SelfTestForm, SelfTestSummary } from '../parts/box_self_test.js';
import { Empty, Notice } from '../parts/notice.js';
import { isOfOlder } from './steps.js';

const words = t.setup.test;

export function TestStep({ box, at, onChange }) {
  const lacks = box.calibration ? (box.palette ? null : 'colours') : 'calibration';
  if (lacks)
    return html`<${Empty} title=${words.needs[lacks]} body=${words.needsBody}>
      <a class="button main" href=${at(lacks)}>${t.setup[lacks].title}</a><//>`;
  const [test] = box.selfTests;
  return html`
    ${test && isOfOlder(test, box) && html`<${Notice} tone="warn" quiet title=${words.older}>${words.olderBody}<//>`}
    <${SelfTestSummary} tests=${box.selfTests} />
    <${SelfTestForm} box=${box} camera=${box.camera} isFirst=${box.selfTests.length === 0} onChange=${onChange} />`;
}
