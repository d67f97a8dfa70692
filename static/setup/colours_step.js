// Step 5: the colours of tapes and bare shafts. The person paints on frames of the box; all frames show what would be
// taken for them.
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
import { EmptyBox, takeEmptyBox } from './empty_box.js';
import { FrameSources } from './frame_sources.js';
import { FrameStrip } from './frame_strip.js';
import { coloursOf, isBare, isMarked } from './marks.js';
import { PaintPanel } from './paint_panel.js';
import { learningForm, usePreview } from './preview.js';
import { isComplete, isOutdated, plannedTool } from './steps.js';
import { inkOf } from './tapes.js';

const words = t.setup.colours;

/** The texts of the step for these instruments. */
function wordsFor(tools) {
  if (!tools.some(isBare)) return words;
  const paintHow = tools.every(isBare) ? words.bare.paintHow : [...words.paintHow, ...words.bare.paintHow];
  return { ...words, ...words.bare, paintHow };
}

/** @param {Props} props */
export function ColoursStep({ box, draft, stepHref, onChange }) {
  const [problem, setProblem] = useState(null);
  const [chosen, setChosen] = useState(null);
  // Fixed at first: it must not close around the camera at the first frame.
  const [opened] = useState(draft.frames.length === 0);
  const { preview, problem: previewProblem, isAsking } = usePreview(box, draft);
  const { frames, plan } = draft;
  const [colours, own] = [coloursOf(plan.tools), wordsFor(plan.tools)];
  const hasBare = plan.tools.some(isBare);
  const ink = label => inkOf(label, colours);
  const frame = frames.find(({ number }) => number === chosen) ?? frames[0];
  const maskOf = number => {
    const mask = preview?.frames.find(one => one.frame === number);
    return mask && { ...mask, colours: preview?.colours };
  };
  const shaftsOf = number => preview?.shafts.filter(one => one.frame === number) ?? [];
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
      <${FrameSources} box=${box} draft=${draft} onProblem=${setProblem}
        onEmptyBox=${hasBare && (blob => takeEmptyBox(draft, blob, setProblem))} />
    </details>
    ${hasBare && html`<${EmptyBox} box=${box} draft=${draft} onProblem=${setProblem} />`}
    ${frame && html`
      <${PaintPanel} draft=${draft} frame=${frame} colours=${colours} words=${own} inkOf=${ink}
        mask=${maskOf(frame.number)} />
      <${FrameStrip} draft=${draft} chosen=${frame.number} words=${own} onChoose=${setChosen} maskOf=${maskOf}
        shaftsOf=${shaftsOf} inkOf=${ink} isAsking=${isAsking} isShown=${Boolean(preview)} />
      <${ProblemNotice} problem=${previewProblem} />
      ${preview && preview.verdicts.length > 0 && html`<section class="stack"><h3>${words.worth}</h3>
        <${Verdicts} verdicts=${preview.verdicts} /><${Confusion} rows=${preview.confusion} /></section>`}
      ${preview && hasBare && html`<p class="small muted">${words.bare.judged}</p>`}
      <${Learn} box=${box} draft=${draft} own=${own} onProblem=${setProblem} onChange=${onChange} />`}
    ${box.palettes[0] && html`<${Learned} palette=${box.palettes[0]} />`}
    ${!plan.tools.every(isBare) && html`<${PaletteAdvice} box=${box} />`}`;
}

/** What is still to be painted, or the button. `own`: the texts for these instruments. @param {Props} props */
function Learn({ box, draft, own, onProblem, onChange }) {
  const [isSending, setSending] = useState(false);
  const unmarkedOf = list => coloursOf(list).filter(colour => !isMarked(draft.frames, colour));
  const { tools } = draft.plan;
  const tapes = unmarkedOf(tools.filter(tool => !isBare(tool)));
  const shafts = unmarkedOf(tools.filter(isBare));
  const isMissing = tapes.length + shafts.length > 0;
  const noBackground = !isMarked(draft.frames, 'background');
  const job = draft.job.colours;
  const learn = async () => {
    setSending(true);
    onProblem(null);
    try {
      draft.job.colours = jobIdOf(await api.boxes.learnPalette(box.id, learningForm(box, draft)));
    } catch (error) {
      onProblem(asProblem(error));
    }
    setSending(false);
  };
  return html`
    ${isOutdated(tools, box.palettes[0]) && html`<${Notice} tone="warn" quiet title=${words.outdated}>${words.outdatedBody}<//>`}
    ${tapes.length > 0 && html`<${Notice} tone="warn" quiet title=${words.unmarked(tapes)} />`}
    ${shafts.length > 0 && html`<${Notice} tone="warn" quiet title=${words.bare.unmarkedShaft} />`}
    ${!isMissing && noBackground && html`<${Notice} tone="warn" quiet title=${own.noBackground} />`}
    <div class="row"><button class="button main" type="button" disabled=${isMissing || noBackground || isSending}
      onClick=${learn}>${isSending ? t.box.sending : t.box.learn}</button></div>
    ${job && html`<${JobProgress} key=${job} id=${job} done=${t.box.learned} onDone=${onChange} />`}`;
}

const Learned = ({ palette }) => html`
  <section class="stack" data-palette=${palette.version}>
    <h3>${words.learned}</h3>
    <p class="small muted">${t.box.learnedAs(palette.version, dateTime(palette.created_at))}</p>
    ${palette.verdicts?.length > 0 && html`<${Verdicts} verdicts=${palette.verdicts} />`}
  </section>`;
