"""The stages of a detection, in the order of `run`.

pieces   pieces/covers.py (entry), pieces/cutting.py
stage 1  `solve`: stage1_broad_phase.py; whole scenes and Spark: kernel/boxes.py; changes: sql/20
stage 2  stage2_intersection.py; few pieces: sql/21
stage 3  kernel/narrow/certain.c (`closed_form`); method `nlp`: published/stage3_projection.py
stage 4  stage4/contact_search.py, which calls kernel/narrow/search.c; method `nlp`: published/guesses.py
rows     merge.py makes rows of pairs of objects
"""
