#include "segmentation/merge_regions.h"

#include <algorithm>
#include <tuple>
#include <utility>

namespace usdfoliage {

namespace {

using Pair = std::pair<std::int64_t, std::int64_t>;

constexpr std::int64_t kNone = -1;

struct Link {
    std::int64_t region;
    double weight;
};

using Links = std::vector<Link>;  // of one region, in the order of the regions that they lead to

// A link on its way to a new list, and the two regions that it was between: these order the links that are summed.
struct MovedLink {
    std::int64_t region, low, high;
    double weight;

    bool operator<(const MovedLink& other) const {
        return std::tie(region, low, high) < std::tie(other.region, other.low, other.high);
    }
};

// Regions without order, none twice.
class RegionSet {
public:
    explicit RegionSet(std::size_t count) : is_in_(count, false) {}

    void add(std::int64_t region) {
        if (is_in_[region]) return;
        is_in_[region] = true;
        regions_.push_back(region);
    }

    void clear() {
        for (const std::int64_t region : regions_) is_in_[region] = false;
        regions_.clear();
    }

    const std::vector<std::int64_t>& regions() const { return regions_; }

private:
    std::vector<bool> is_in_;
    std::vector<std::int64_t> regions_;
};

struct Best {
    std::int64_t region = kNone;
    double strength = -1.0, weight = 0.0;
};

class Merging {
public:
    Merging(std::size_t count, const std::int64_t* first, const std::int64_t* second, const double* weight, std::size_t n,
            const double* divisor, double weakest)
        : links_(count), size_(count, 1), node_(count), becomes_(count), best_(count), changed_(count), relisted_(count),
          divisor_(divisor), weakest_(weakest) {
        std::vector<std::size_t> degree(count, 0);
        for (std::size_t i = 0; i < n; ++i) {
            ++degree[first[i]];
            ++degree[second[i]];
        }
        for (std::size_t region = 0; region < count; ++region) {
            links_[region].reserve(degree[region]);
            node_[region] = becomes_[region] = static_cast<std::int64_t>(region);
            changed_.add(node_[region]);
        }
        // A region's lower neighbours come before its higher ones, and each of both in their order.
        for (std::size_t i = 0; i < n; ++i) links_[second[i]].push_back({first[i], weight[i]});
        for (std::size_t i = 0; i < n; ++i) links_[first[i]].push_back({second[i], weight[i]});
        made_.rounds.push_back(0);
    }

    MergedRegions merge() {
        while (true) {
            for (const std::int64_t region : changed_.regions()) find_best(region);
            const std::vector<Pair> pairs = reciprocal_pairs();
            if (pairs.empty()) return std::move(made_);
            changed_.clear();
            relisted_.clear();
            for (const auto& [larger, smaller] : pairs) becomes_[smaller] = larger;
            for (const auto& [larger, smaller] : pairs) find_affected(larger, smaller);
            relist(pairs);
            for (const auto& [larger, smaller] : pairs) record(larger, smaller);
            made_.rounds.push_back(static_cast<std::int64_t>(made_.size.size()));
        }
    }

private:
    // The first of equals stays, as links are in the order of their two points.
    void find_best(std::int64_t region) {
        Best best;
        for (const Link& link : links_[region]) {
            const double strength = link.weight / divisor_[std::min(size_[region], size_[link.region])];
            if (strength > best.strength) best = {link.region, strength, link.weight};
        }
        best_[region] = best;
    }

    // Pairs to be joined, the larger first, in the order of their points; one of each has changed in the last round.
    std::vector<Pair> reciprocal_pairs() const {
        std::vector<Pair> pairs;
        for (const std::int64_t region : changed_.regions()) {
            const Best& best = best_[region];
            if (best.region != kNone && best_[best.region].region == region && best.strength > weakest_)
                pairs.emplace_back(std::min(region, best.region), std::max(region, best.region));
        }
        std::sort(pairs.begin(), pairs.end());
        pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
        for (auto& [one, two] : pairs)
            if (size_[one] < size_[two]) std::swap(one, two);
        return pairs;
    }

    void find_affected(std::int64_t larger, std::int64_t smaller) {
        changed_.add(larger);
        relisted_.add(larger);
        for (const Link& link : links_[smaller]) {
            if (becomes_[link.region] != link.region) continue;
            changed_.add(link.region);
            relisted_.add(link.region);
        }
        // How strong a link to a larger region is depends on the size that grows now.
        for (const Link& link : links_[larger])
            if (becomes_[link.region] == link.region && size_[link.region] > size_[larger]) changed_.add(link.region);
    }

    // New lists of all that have a link to a region that is joined to another; every one is made of old lists.
    void relist(const std::vector<Pair>& pairs) {
        std::vector<Links> lists;
        lists.reserve(relisted_.regions().size());
        absorbs_.clear();
        for (const auto& [larger, smaller] : pairs) absorbs_.emplace_back(larger, smaller);
        std::sort(absorbs_.begin(), absorbs_.end());
        for (const std::int64_t region : relisted_.regions()) {
            const auto found = std::lower_bound(absorbs_.begin(), absorbs_.end(), Pair{region, kNone});
            const bool absorbs = found != absorbs_.end() && found->first == region;
            lists.push_back(new_list(region, absorbs ? found->second : kNone));
        }
        for (std::size_t i = 0; i < lists.size(); ++i) links_[relisted_.regions()[i]] = std::move(lists[i]);
        for (const auto& pair : pairs) Links().swap(links_[pair.second]);
    }

    Links new_list(std::int64_t region, std::int64_t absorbed) {
        stays_.clear();
        moves_.clear();
        for (const std::int64_t from : {region, absorbed}) {
            if (from == kNone) continue;
            for (const Link& link : links_[from]) {
                const std::int64_t to = becomes_[link.region];
                if (to == region) continue;
                const MovedLink moved{to, std::min(from, link.region), std::max(from, link.region), link.weight};
                (from == region && to == link.region ? stays_ : moves_).push_back(moved);
            }
        }
        std::sort(moves_.begin(), moves_.end());
        Links list;
        list.reserve(stays_.size() + moves_.size());
        auto stay = stays_.cbegin(), move = moves_.cbegin();
        while (stay != stays_.cend() || move != moves_.cend()) {
            const bool is_stay = move == moves_.cend() || (stay != stays_.cend() && *stay < *move);
            const MovedLink& next = is_stay ? *stay++ : *move++;
            if (!list.empty() && list.back().region == next.region)
                list.back().weight += next.weight;
            else
                list.push_back({next.region, next.weight});
        }
        list.shrink_to_fit();
        return list;
    }

    void record(std::int64_t larger, std::int64_t smaller) {
        made_.children.push_back(node_[larger]);
        made_.children.push_back(node_[smaller]);
        made_.linkage.push_back(best_[larger].strength);
        made_.across.push_back(best_[larger].weight);
        size_[larger] += size_[smaller];
        node_[larger] = static_cast<std::int64_t>(links_.size() + made_.size.size());
        made_.size.push_back(size_[larger]);
    }

    std::vector<Links> links_;
    std::vector<std::int64_t> size_, node_;
    std::vector<std::int64_t> becomes_;  // the region that each is a part of, itself where it is not joined to another
    std::vector<Best> best_;
    RegionSet changed_, relisted_;  // regions of which a link has changed; of those, the ones that get a new list
    std::vector<Pair> absorbs_;
    std::vector<MovedLink> stays_, moves_;
    MergedRegions made_;
    const double* divisor_;
    double weakest_;
};

}  // namespace

MergedRegions merge_regions(std::size_t count, const std::int64_t* first, const std::int64_t* second, const double* weight,
                            std::size_t n, const double* divisor, double weakest) {
    return Merging(count, first, second, weight, n, divisor, weakest).merge();
}

}  // namespace usdfoliage
