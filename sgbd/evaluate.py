"""python -m sgbd.evaluate: score a trained model, or another system's label images, on frames with ground truth."""

from __future__ import annotations

from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.evaluation import Evaluator
from sgbd.jobs.configuration import ConfigurationError, count_workers, entry_point, output_folder
from sgbd.jobs.pipeline import checkpoint_graphs, frame_source_of_split
from sgbd.label_images import LabelImages
from sgbd.label_map_evaluation import evaluate_label_maps
from sgbd.reporting.results import draw_examples, example_frames, markdown, write_evaluation
from sgbd.segmenter import Segmenter


@entry_point("evaluate")
def main(config: DictConfig) -> None:
    """Prepare the frames with the checkpoint's recipe, score the model on them, and write tables and pictures."""
    if config.predictions is not None:
        _score_label_images(config)
        return
    path = find_checkpoint(config.checkpoint, config.output_dir)
    trust = tuple(config.trust)
    checkpoint = Checkpoint.load(path, trust)
    segmenter = Segmenter(
        checkpoint,
        partition=instantiate(config.partition),
        rule=instantiate(config.objects),
        node_block=instantiate(config.node_block),
        device=config.device,
        trust=trust,
    )
    source = frame_source_of_split(config.dataset, count_workers(config.workers), config.split)
    dataset = checkpoint_graphs(config, checkpoint, segmenter, source)
    evaluate = Evaluator(
        segmenter.partition, segmenter.rule, boundaries=config.boundaries, calibration=segmenter.calibration
    )
    evaluation = evaluate(dataset, segmenter.model, segmenter.objectness, progress=True)
    out = output_folder()
    # Record what was scored, and on which frames.
    OmegaConf.save(config, out / "config.yaml")
    write_evaluation(evaluation, out)
    draw_examples(example_frames(evaluation, config.pictures), evaluation, source, segmenter, out)
    # The preparation has logged which frames it skipped, and why.
    skipped = f" ({len(dataset.skipped)} more skipped, see above)" if dataset.skipped else ""
    frames = f"{len(dataset)} frame{'s'[: len(dataset) != 1]} of {source.split}{skipped}"
    print(f"\n{path} on {frames}, per cent:\n\n{markdown(evaluation)}\n")
    print(f"Scores of every frame and pictures: {out}")


def _score_label_images(config: DictConfig) -> None:
    """Score the label images of another system with the same metrics."""
    if config.checkpoint is not None:
        raise ConfigurationError("give checkpoint (a trained model) or predictions (label images), not both")
    workers = count_workers(config.workers)
    source = frame_source_of_split(config.dataset, workers, config.split)
    found = evaluate_label_maps(
        source,
        LabelImages(config.predictions, config.first_object),
        workers=workers,
        boundaries=config.boundaries,
        on_error=config.on_error,
        progress=True,
    )
    out = output_folder()
    OmegaConf.save(config, out / "config.yaml")
    write_evaluation(found.evaluation, out)
    left_out = f" ({len(found.left_out)} more left out, see above)" if found.left_out else ""
    count = len(found.failures)
    frames = f"{count} frame{'s'[: count != 1]} of {source.split}{left_out}"
    print(f"\n{config.predictions} on {frames}, per cent:\n\n{markdown(found.evaluation)}\n")
    print(f"Scores of every frame: {out}")


if __name__ == "__main__":
    main()
