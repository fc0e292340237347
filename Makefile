# make demo   a photograph to an asset, its preview and its report     make test   the whole suite, with lint and types
SHELL := /bin/bash
PYTHON_VENV := .venv/bin/python
DEMO := out/demo

.PHONY: setup demo test lint bench clean

setup:
	@tools/bootstrap.sh all

demo: setup
	@$(PYTHON_VENV) -m usdfoliage crown tools/demo/crown.jpg --mask tools/demo/crown_mask.png -o $(DEMO)

lint: setup
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/mypy

test: lint
	@$(PYTHON_VENV) -m pytest -m "not slow"

bench: setup
	@$(PYTHON_VENV) tools/bench/texture.py
	@$(PYTHON_VENV) tools/bench/mask_proposal.py
	@$(PYTHON_VENV) tools/bench/crown.py
	@$(PYTHON_VENV) -m pytest -m slow || [ $$? = 5 ]

clean:
	rm -rf .venv .venv-preview build out .mypy_cache .ruff_cache .pytest_cache .hypothesis
