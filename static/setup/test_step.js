// Step 7: the self-test of one minute, which shows whether everything is right.
import { html } from '../preact.js';
import { t } from '../texts.js';
import { SelfTestForm, SelfTestSummary } from '../parts/boxes/box_self_test.js';
import { Empty, Notice } from '../parts/page/notice.js';
import { isTestOutdated } from './steps.js';

const words = t.setup.test;

/** @param {Props} props */
export function TestStep({ box, stepHref, onChange }) {
  const missingStep = box.calibration ? (box.palette ? null : 'colours') : 'calibration';
  if (missingStep)
    return html`<${Empty} title=${words.needs[missingStep]} body=${words.needsBody}>
      <a class="button main" href=${stepHref(missingStep)}>${t.setup[missingStep].title}</a><//>`;
  const [test] = box.selfTests;
  return html`
    ${test && isTestOutdated(test, box) && html`<${Notice} tone="warn" quiet title=${words.older}>${words.olderBody}<//>`}
    <${SelfTestSummary} box=${box} tests=${box.selfTests} />
    <${SelfTestForm} box=${box} camera=${box.camera} isFirst=${box.selfTests.length === 0} onChange=${onChange} />`;
}
