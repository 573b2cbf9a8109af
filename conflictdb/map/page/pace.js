// How often something is done, and what waits meanwhile.

const PICTURES = 4; // that may be late
const RESTING = 3; // pictures without a request, which moving time makes for each
const LONGEST_MS = 2000; // a page in the background has no pictures

// Does what takes a while not before some time has gone by, and for no more than a share of the time; but at once when nobody asks
// any more.
export class Paced {
  // `does` returns how long it took, milliseconds.
  constructor(does, leastMs, mostShare) {
    Object.assign(this, { does, leastMs, mostShare });
    this.begun = 0;
    this.asked = 0; // the last time
    this.took = 0; // milliseconds, the last time
    this.timer = null;
  }

  now() {
    clearTimeout(this.timer);
    this.timer = null;
    this.begun = performance.now();
    this.took = this.does();
    this.watch(PICTURES);
  }

  // Maps are drawn by another thread, which delays only the pictures that follow: the longest wait for one of them counts.
  watch(pictures, before = performance.now()) {
    if (pictures === 0) return;
    requestAnimationFrame((at) => {
      this.took = Math.max(this.took, at - before);
      this.watch(pictures - 1, at);
    });
  }

  soon() {
    const asked = this.asked = performance.now();
    const wait = this.begun + Math.min(LONGEST_MS, Math.max(this.leastMs, this.took / this.mostShare)) - asked;
    if (wait <= 0) {
      this.now();
      return;
    }
    this.timer ??= setTimeout(() => this.now(), wait);
    this.afterRest(asked, RESTING);
  }

  afterRest(asked, pictures) {
    requestAnimationFrame(() => {
      if (this.timer === null || this.asked !== asked) return;
      if (pictures > 1) this.afterRest(asked, pictures - 1);
      else this.now();
    });
  }
}

// Reads what changed, "objects" (and with them all else) or "conflicts": one reading at a time. What changes meanwhile is read
// after that, once.
export class Readings {
  // `read(what)` reads, and shows what it read; `failed(error)` hears of an error.
  constructor(read, failed) {
    Object.assign(this, { read, failed });
    this.wanted = null;
    this.under = null; // the reading under way
  }

  async want(what) {
    if (this.wanted !== "objects") this.wanted = what;
    this.under ??= this.readAll();
    return this.under;
  }

  async readAll() {
    try {
      while (this.wanted) {
        const now = this.wanted;
        this.wanted = null;
        await this.read(now);
      }
    } catch (error) {
      this.failed(error);
    } finally {
      this.under = null;
    }
  }
}
