// Setting up a box, step by step, for people who have never done it: one step on the page at a time, each with its
// state.
import { html, useEffect, useRef } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { inUseFirst } from '../parts/boxes/box_versions.js';
import { NotYours } from '../parts/forms/owners.js';
import { Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { useSetupDraft } from '../setup/draft.js';
import { BoardStep } from '../setup/board_step.js';
import { CalibrationStep } from '../setup/calibration_step.js';
import { ColoursStep } from '../setup/colours_step.js';
import { PhotosStep } from '../setup/photos_step.js';
import { nextStep, STEPS, stepStates } from '../setup/steps.js';
import { TestStep } from '../setup/test_step.js';
import { TokenStep } from '../setup/token_step.js';
import { ToolsStep } from '../setup/tools_step.js';

const words = t.setup;
const BODIES = {
  board: BoardStep,
  photos: PhotosStep,
  calibration: CalibrationStep,
  tools: ToolsStep,
  colours: ColoursStep,
  agent: TokenStep,
  test: TestStep,
};

/** @param {Props} props */
export default function SetupPage({ person, route }) {
  const { id } = route.params;
  const draft = useSetupDraft(person.id, id);
  const mayCreateTokens = may(person, 'people');
  const load = async signal => {
    const [box, palettes, calibrations, selfTests, tokens] = await Promise.all([
      api.boxes.get(id, signal),
      api.boxes.palettes(id),
      api.boxes.calibrations(id),
      api.boxes.selfTests(id),
      mayCreateTokens ? api.tokens.all() : null,
    ]);
    const camera = box.calibration && (await api.boxes.camera(id));
    return { ...box, camera, palettes: inUseFirst(palettes), calibrations, selfTests, tokens: tokens?.filter(token => token.box === box.id) };
  };
  const { data: box, problem, reload } = useData(load, [id]);
  const states = box && stepStates(box, draft);
  const requestedStep = route.query.get('step');
  // If the address names no step: the step that was next at first. Typing in a step must not switch to another one.
  const first = useRef(null);
  first.current ??= states ? nextStep(states) : null;
  const step = requestedStep && STEPS.includes(requestedStep) ? requestedStep : first.current;
  useFocusOnStep(box && step);
  if (!box)
    return html`<${PageHead} title=${t.nav.boxes} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  if (!box.may_change)
    return html`<${PageHead} title=${words.title(box.name)}>
      <a class="button" href=${href(['boxes', id])}>${t.record.toBox}</a><//><${NotYours} />`;
  const stepHref = one => href(['boxes', id, 'setup'], { step: one });
  return html`
    <${PageHead} title=${words.title(box.name)} lead=${words.lead}>
      <a class="button" href=${href(['boxes', id])}>${t.record.toBox}</a>
    <//>
    <div class="stack">
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${box.calibration && box.palette && html`<${Notice} tone="good" title=${t.box.ready} quiet>
        <a href=${href(['record'], { box: box.id })}>${words.record}</a><//>`}
      <div class="setup">
        <${Steps} step=${step} states=${states} stepHref=${stepHref} />
        <${Step} key=${step} step=${step} stepHref=${stepHref}>
          <${BODIES[step]} box=${box} draft=${draft} person=${person} stepHref=${stepHref} onChange=${reload} />
        <//>
      </div>
    </div>`;
}

const Steps = ({ step, states, stepHref }) => html`
  <nav class="setup-steps" aria-label=${words.steps}>
    <ol>
      ${STEPS.map((one, index) => html`
        <li key=${one}>
          <a href=${stepHref(one)} aria-current=${one === step ? 'step' : undefined}>
            <span class=${`mark ${states[one]}`} aria-hidden="true">${states[one] === 'done' ? '✓'
              : states[one] === 'again' ? '!' : index + 1}</span>
            <span class="name">${words[one].title}</span>
            <span class="state">${words.states[states[one]]}</span>
          </a>
        </li>`)}
    </ol>
  </nav>`;

/** Screen readers announce the title of each step; at first the focus is on the page's own title. */
function useFocusOnStep(step) {
  const last = useRef(null);
  useEffect(() => {
    if (last.current && step !== last.current) {
      scrollTo(0, 0);
      document.getElementById('setup-step')?.focus({ preventScroll: true });
    }
    last.current = step;
  }, [step]);
}

function Step({ step, stepHref, children }) {
  const index = STEPS.indexOf(step);
  const [before, after] = [STEPS[index - 1], STEPS[index + 1]];
  return html`
    <section class="card setup-step" aria-labelledby="setup-step">
      <header><h2 id="setup-step" tabindex="-1">${words.numbered(index + 1, words[step].title)}</h2></header>
      <div class="body stack">
        <p class="lead">${words[step].lead}</p>
        ${children}
        <div class="row apart setup-ends">
          ${before ? html`<a class="button" href=${stepHref(before)}>${words.back(words[before].title)}</a>` : html`<span></span>`}
          ${after && html`<a class="button" href=${stepHref(after)}>${words.on(words[after].title)}</a>`}
        </div>
      </div>
    </section>`;
}
