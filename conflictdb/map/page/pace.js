// How often something is done, and what waits meanwhile.

const PICTURES = 4;
const LONGEST_MS = 2000;

// Does what takes a while not before some time has gone by, and for no more than a share of the time; what is asked for after a
// rest is not put off.
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
    const asked = performance.now();
    const isAfterRest = asked - this.asked > Math.max(this.leastMs, 2 * this.took); // longer than a picture
    this.asked = asked;
    const apart = isAfterRest ? 0 : Math.min(LONGEST_MS, this.took / this.mostShare); // a page in the background has no pictures
    const wait = this.begun + Math.max(this.leastMs, apart) - asked;
    clearTimeout(this.timer);
    if (wait <= 0) this.now();
    else this.timer = setTimeout(() => this.now(), Math.min(wait, this.leastMs)); // at the latest when nobody asks any more
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
