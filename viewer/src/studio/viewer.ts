// The viewer, which the page has loaded as a file of its own: reports hold the same one.

import type * as Loaded from "../main";

export const { modelOf, Viewer } = (globalThis as unknown as { cascadenormViewer: typeof Loaded }).cascadenormViewer;
export type Viewer = Loaded.Viewer;
