// What was there before: states in the order in which they were made.

export class History<State> {
  private states: State[] = [];
  private at = -1;

  constructor(private readonly most = 100) {}

  begin(state: State): void {
    this.states = [state];
    this.at = 0;
  }

  push(state: State): void {
    this.states = [...this.states.slice(0, this.at + 1), state].slice(-this.most);
    this.at = this.states.length - 1;
  }

  get canUndo(): boolean {
    return this.at > 0;
  }

  get canRedo(): boolean {
    return this.at < this.states.length - 1;
  }

  undo(): State {
    return this.states[--this.at];
  }

  redo(): State {
    return this.states[++this.at];
  }
}
