// The instruments of a setup draft: with tape, or bare. Two bare ones can be followed, one on each side of the picture.
import { isBare } from './marks.js';

/** The label of the pieces of a bare shaft. */
const SHAFT = 'shaft';
const SIDES = ['left', 'right'];

/** Whether the tool at `index` may be bare: at most one of the others comes from each side. */
export const mayBeBare = (tools, index) =>
  tools.filter((tool, at) => at !== index && isBare(tool)).length < SIDES.length;

/** The tools with one more, which is bare if the last one is. */
export function withAdded(tools) {
  const id = 1 + Math.max(0, ...tools.map(tool => tool.id));
  const last = tools[tools.length - 1];
  const isNewBare = last && isBare(last) && mayBeBare(tools, tools.length);
  return [...tools, isNewBare ? bareTool(id, tools) : tapedTool(id)];
}

/** The tools with the one at `index` made bare, or made one with tape. */
export const withKind = (tools, index, bare) =>
  tools.map((tool, at) => (at !== index ? tool : bare ? bareTool(tool.id, tools) : tapedTool(tool.id)));

/** The tools with changes of the one at `index`. A bare tool whose side is taken changes sides with the other one. */
export function withChange(tools, index, more) {
  const changed = { ...tools[index], ...more };
  const isInTheWay = tool => isBare(tool) && isBare(changed) && tool.side === changed.side;
  const moved = tool => (isInTheWay(tool) ? { ...tool, side: otherSide(tool.side) } : tool);
  return tools.map((tool, at) => (at === index ? changed : moved(tool)));
}

const otherSide = side => SIDES.find(other => other !== side);

const tapedTool = id => ({ id, tape: '', name: '', side: '' });

/** Without a diameter: a usual one would be taken for measured, and all lengths grow with it. */
function bareTool(id, tools) {
  const taken = tools.filter(tool => tool.id !== id && isBare(tool)).map(tool => tool.side);
  const side = SIDES.find(one => !taken.includes(one));
  return { id, tape: SHAFT, name: '', side, marker: { kind: 'shaft' } };
}
