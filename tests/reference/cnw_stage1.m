function weight = cnw_stage1(fix, hdop)
% CNW_STAGE1  Classification and weighing, stage 1: fix quality and HDOP to a weight 0 (BAD) to 3 (IDEAL).
%   Element by element, after Code 3 of the 2019 paper.
  differential = fix >= 2 & fix <= 5;
  single = fix == 1;
  weight = zeros(size(fix));
  weight(differential & hdop > 0 & hdop <= 2) = 3;
  weight(single       & hdop > 0 & hdop <= 2) = 2;
  weight(differential & hdop > 2 & hdop <= 5) = 2;
  weight(differential & hdop > 5 & hdop <= 10) = 1;
  weight(single       & hdop > 2 & hdop <= 5) = 1;
end
