// Setting up a box, step by step, for somebody who has never done it: one step on the page at a time, each with how it stands.
import { html, useEffect, useRef } from '../parts/preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Loading, Notice, PageHead, ProblemNotice } from '../parts/notice.js';
import { useBench } from '../setup/bench.js';
import { BoardStep } from '../setup/board_step.js';
import { CalibrationStep } from '../setup/calibration_step.js';
import { ColoursStep } from '../setup/colours_step.js';
import { PhotosStep } from '../setup/photos_step.js';
import { nextOf, statesOf, STEPS } from '../setup/steps.js';
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

export default function SetupPage({ person, route }) {
  const id = route.path[1];
  const bench = useBench(person.id, id);
  const mayToken = may(person, 'people');
  const load = async signal => {
    const [box, palettes, calibrations, selfTests, tokens] = await Promise.all([
      api.boxes.get(id, signal),
      api.boxes.palettes(id),
      api.boxes.calibrations(id),
      api.boxes.selfTests(id),
      mayToken ? api.tokens.all() : null,
    ]);
    const camera = box.calibration && (await api.boxes.camera(id));
    return { ...box, camera, palettes, calibrations, selfTests, tokens: tokens?.filter(token => token.box === box.id) };
  };
  const { data: box, problem, reload } = useData(load, [id]);
  const states = box && statesOf(box, bench);
  const asked = route.query.get('step');
  // Where the address names no step, the one that was next at first: what is typed in it must not turn the page.
  const first = useRef(null);
  first.current ??= states ? nextOf(states) : null;
  const step = STEPS.includes(asked) ? asked : first.current;
  useFocusOn(box && step);
  if (!box)
    return html`<${PageHead} title=${t.nav.boxes} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const at = one => href(['boxes', id, 'setup'], { step: one });
  return html`
    <${PageHead} title=${words.title(box.name)} lead=${words.lead}>
      <a class="button" href=${href(['boxes', id])}>${t.record.toBox}</a>
    <//>
    <div class="stack">
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${box.calibration && box.palette && html`<${Notice} tone="good" title=${t.box.ready} quiet>
        <a href=${href(['record'], { box: box.id })}>${words.record}</a><//>`}
      <div class="setup">
        <${Steps} step=${step} states=${states} at=${at} />
        <${Step} key=${step} step=${step} at=${at}>
          <${BODIES[step]} box=${box} bench=${bench} person=${person} at=${at} onChange=${reload} />
        <//>
      </div>
    </div>`;
}

const Steps = ({ step, states, at }) => html`
  <nav class="setup-steps" aria-label=${words.steps}>
    <ol>
      ${STEPS.map((one, index) => html`
        <li key=${one}>
          <a href=${at(one)} aria-current=${one === step ? 'step' : undefined}>
            <span class=${`mark ${states[one]}`} aria-hidden="true">${states[one] === 'done' ? '✓'
              : states[one] === 'again' ? '!' : index + 1}</span>
            <span class="name">${words[one].title}</span>
            <span class="state">${words.states[states[one]]}</span>
          </a>
        </li>`)}
    </ol>
  </nav>`;

/** Whoever goes from step to step hears the title of each; the page's own title has the focus at first. */
function useFocusOn(step) {
  const last = useRef(null);
  useEffect(() => {
    if (last.current && step !== last.current) {
      scrollTo(0, 0);
      document.getElementById('setup-step')?.focus({ preventScroll: true });
    }
    last.current = step;
  }, [step]);
}

function Step({ step, at, children }) {
  const index = STEPS.indexOf(step);
  const [before, after] = [STEPS[index - 1], STEPS[index + 1]];
  return html`
    <section class="card setup-step" aria-labelledby="setup-step">
      <header><h2 id="setup-step" tabindex="-1">${words.numbered(index + 1, words[step].title)}</h2></header>
      <div class="body stack">
        <p class="lead">${words[step].lead}</p>
        ${children}
        <div class="row apart setup-ends">
          ${before ? html`<a class="button" href=${at(before)}>${words.back(words[before].title)}</a>` : html`<span></span>`}
          ${after && html`<a class="button" href=${at(after)}>${words.on(words[after].title)}</a>`}
        </div>
      </div>
    </section>`;
}
