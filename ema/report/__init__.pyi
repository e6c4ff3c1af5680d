from ema.report.writing import write as write
