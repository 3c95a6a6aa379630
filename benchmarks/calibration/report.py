def write_report(waves, request, store):
    import numpy as np

    for w in waves:
        print(w.number, w.whole.volume, w.whole.cutoff, w.correlated.volume, w.correlated.cutoff)
        for t, e in zip(w.targets, w.emulators):
            print(t.kind, t.name, round(e.misfit, 2), round(e.explained, 2))
        print([m.failure for m in w.measured if m.failure])
    return ""
