// Step 5: the tapes' colours. The person paints on frames of the box; all frames show what the tracker would take for
// tape.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { dateTime } from '../format.js';
import { t } from '../texts.js';
import { jobIdOf, JobProgress } from '../parts/forms/job.js';
import { Empty, Notice, ProblemNotice } from '../parts/page/notice.js';
import { PaletteAdvice } from '../parts/boxes/box_advice.js';
import { Verdicts } from '../parts/boxes/box_palette.js';
import { Confusion } from './confusion.js';
import { FrameSources } from './frame_sources.js';
import { FrameStrip } from './frame_strip.js';
import { isMarked, tapesOf } from './marks.js';
import { PaintPanel } from './paint_panel.js';
import { paletteForm, usePreview } from './preview.js';
import { isComplete, isOutdated, plannedTool } from './steps.js';
import { inkOf } from './tapes.js';

const words = t.setup.colours;

/** @param {Props} props */
export function ColoursStep({ box, draft, stepHref, onChange }) {
  const [problem, setProblem] = useState(null);
  const [chosen, setChosen] = useState(null);
  // Fixed at first: it must not close around the camera at the first frame.
  const [opened] = useState(draft.frames.length === 0);
  const { preview, problem: previewProblem, isAsking } = usePreview(box, draft);
  const tapes = tapesOf(draft.plan.tools);
  const ink = label => inkOf(label, tapes);
  const { frames } = draft;
  const frame = frames.find(({ number }) => number === chosen) ?? frames[0];
  const maskOf = number => {
    const mask = preview?.frames.find(one => one.frame === number);
    return mask && { ...mask, colours: preview?.colours };
  };
  const isDescribed = draft.plan.tools.length > 0 && draft.plan.tools.every(isComplete);
  if (draft.plan.tools.length === 0 && box.tools.length > 0)
    return html`
      <${Notice} tone="good" quiet title=${t.setup.tools.known(box.tools.map(({ name }) => name))}>${words.knownBody}<//>
      <div class="row"><button class="button" type="button"
        onClick=${() => draft.setPlan({ tools: box.tools.map(plannedTool) })}>${words.anew}</button></div>
      ${box.palettes[0] && html`<${Learned} palette=${box.palettes[0]} />`}`;
  if (!isDescribed)
    return html`<${Empty} title=${words.needTools} body=${words.needToolsBody}>
      <a class="button main" href=${stepHref('tools')}>${t.setup.tools.title}</a><//>
      ${box.palettes[0] && html`<${Learned} palette=${box.palettes[0]} />`}`;
  return html`
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
    <details open=${opened}>
      <summary>${words.add}</summary>
      <${FrameSources} box=${box} draft=${draft} onProblem=${setProblem} />
    </details>
    ${frame && html`
      <${PaintPanel} draft=${draft} frame=${frame} tapes=${tapes} inkOf=${ink} mask=${maskOf(frame.number)} />
      <${FrameStrip} draft=${draft} chosen=${frame.number} onChoose=${setChosen} maskOf=${maskOf} inkOf=${ink}
        isAsking=${isAsking} isShown=${Boolean(preview)} />
      <${ProblemNotice} problem=${previewProblem} />
      ${preview && html`<section class="stack"><h3>${words.worth}</h3>
        <${Verdicts} verdicts=${preview.verdicts} /><${Confusion} rows=${preview.confusion} /></section>`}
      <${Learn} box=${box} draft=${draft} tapes=${tapes} onProblem=${setProblem} onChange=${onChange} />`}
    ${box.palettes[0] && html`<${Learned} palette=${box.palettes[0]} />`}
    <${PaletteAdvice} box=${box} />`;
}

/** What is still to be painted, or the button. @param {Props} props */
function Learn({ box, draft, tapes, onProblem, onChange }) {
  const [isSending, setSending] = useState(false);
  const unmarked = tapes.filter(tape => !isMarked(draft.frames, tape));
  const noBackground = !isMarked(draft.frames, 'background');
  const job = draft.job.colours;
  const learn = async () => {
    setSending(true);
    onProblem(null);
    try {
      draft.job.colours = jobIdOf(await api.boxes.learnPalette(box.id, paletteForm(box, draft)));
    } catch (error) {
      onProblem(asProblem(error));
    }
    setSending(false);
  };
  return html`
    ${isOutdated(draft.plan.tools, box.palettes[0]) && html`<${Notice} tone="warn" quiet title=${words.outdated}>${words.outdatedBody}<//>`}
    ${unmarked.length > 0 && html`<${Notice} tone="warn" quiet title=${words.unmarked(unmarked)} />`}
    ${unmarked.length === 0 && noBackground && html`<${Notice} tone="warn" quiet title=${words.noBackground} />`}
    <div class="row"><button class="button main" type="button" disabled=${unmarked.length > 0 || noBackground || isSending}
      onClick=${learn}>${isSending ? t.box.sending : t.box.learn}</button></div>
    ${job && html`<${JobProgress} key=${job} id=${job} done=${t.box.learned} onDone=${onChange} />`}`;
}

const Learned = ({ palette }) => html`
  <section class="stack" data-palette=${palette.version}>
    <h3>${words.learned}</h3>
    <p class="small muted">${t.box.learnedAs(palette.version, dateTime(palette.created_at))}</p>
    ${palette.verdicts && html`<${Verdicts} verdicts=${palette.verdicts} />`}
  </section>`;
